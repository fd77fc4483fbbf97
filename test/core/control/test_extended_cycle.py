"""Cycles that are extended while they run: the law continues as if it had the whole reference from the start."""

import numpy as np
import pytest

from pkm_core.control.computed_torque import ComputedTorque, load_torque_control
from pkm_core.control.feasibility import drive_check
from pkm_core.control.forces import coupling_voltage
from pkm_core.control.model import load_model
from pkm_core.control.observer import ObserverController, load_observer
from pkm_core.control.robust import RobustController, load_control
from pkm_core.machines import load_machine
from pkm_core.motion.jog import JogPlanner
from pkm_core.motion.pieces import joined
from pkm_core.motion.trajectory import to_joints

MACHINE = load_machine('four_dof')
MODELS, TS, LIMIT = load_model(MACHINE), MACHINE.sample_time, MACHINE.voltage_limit


@pytest.fixture(scope='module')
def jog():
    """Return [(first sample, joint trajectory)] of the pieces of a jog, and the whole."""
    planner = JogPlanner(MACHINE, MACHINE.home, drive_check(MACHINE, MODELS))
    pieces = [planner.next(0.01 * np.array([part, 0.0, part, 0.0])) for part in (0, 1, 1, -1, 0.5)]
    pieces = [(piece.offset, to_joints(MACHINE, piece.poses)) for piece in pieces]
    whole = pieces[0][1]
    for offset, piece in pieces[1:]:
        whole = joined(whole, offset, piece)
    return pieces, whole


def measured_along(whole):
    return whole.position + 2e-6 * np.random.default_rng(1).standard_normal(whole.position.shape)


def rows_of(trajectory, column=0):
    return [np.ascontiguousarray(rows[:, column]) for rows in trajectory.derivatives()]


def drive(axis, pieces, measured):
    """Return the voltages of an axis that gets each piece with its first sample."""
    voltages = []
    (_, first), *further = pieces
    axis.load(*rows_of(first), np.zeros(len(first)), coupling_voltage(MACHINE, first, 0))
    waiting = dict(further)
    for index, value in enumerate(measured[:, 0]):
        if index in waiting:
            piece = waiting[index]
            axis.extend(index, *rows_of(piece), coupling_voltage(MACHINE, piece, 0))
        voltages.append(axis.update(index, value)[0])
    return np.array(voltages)


def test_extended_robust_law_equals_that_of_the_whole(jog):
    pieces, whole = jog
    measured = measured_along(whole)
    found = drive(RobustController(load_control(MACHINE)['d1'], MODELS['d1'], TS, LIMIT), pieces, measured)
    expected = drive(RobustController(load_control(MACHINE)['d1'], MODELS['d1'], TS, LIMIT), [(0, whole)], measured)
    np.testing.assert_array_equal(found, expected)


def test_extended_observer_law_is_near_that_of_the_whole(jog):
    """Its coupling is filtered over the whole cycle, also backwards; before a piece it expects the stop."""
    pieces, whole = jog
    law, measured = load_observer(MACHINE)['d1'], measured_along(whole)
    found = drive(ObserverController(law, MODELS['d1'], TS, LIMIT), pieces, measured)
    expected = drive(ObserverController(law, MODELS['d1'], TS, LIMIT), [(0, whole)], measured)
    assert np.abs(found - expected).max() < 0.05 * np.abs(expected).max()


def test_extended_computed_torque_equals_that_of_the_whole(jog):
    pieces, whole = jog
    measured, gains = measured_along(whole), load_torque_control(MACHINE)
    laws = [ComputedTorque(MACHINE, gains, MODELS) for _ in range(2)]
    laws[0].load(pieces[0][1], np.zeros_like(pieces[0][1].position))
    laws[1].load(whole, np.zeros_like(whole.position))
    waiting = dict(pieces[1:])
    for index, row in enumerate(measured):
        if index in waiting:
            laws[0].extend(index, *waiting[index].derivatives())
        found, expected = (law.update(index, row)[0] for law in laws)
        np.testing.assert_array_equal(found, expected)
