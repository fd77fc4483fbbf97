"""Motions beyond the drive by the identified model are refused; a command at its limit is noticed."""

import numpy as np
import pytest

from pkm_core.control.controllers import choose_control, make_controller
from pkm_core.control.feasibility import drive_check, needed_voltage
from pkm_core.control.model import Forces, load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import TrajectoryError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

MACHINE = load_machine('four_dof')
MODELS = load_model(MACHINE)


def motion(move_time):
    return load_motion(default_motion(MACHINE)).model_copy(update={'move_time': move_time})


def test_move_beyond_the_drive_is_refused_with_shortest_time():
    """The masses of the design allow 20 ms; by the identified gain d1 needs 14 V."""
    plan(MACHINE, motion(20e-3))
    with pytest.raises(TrajectoryError, match=r'needs 14\.\d V by its model; allowed 10 V; shortest .*: 24.5 ms'):
        plan(MACHINE, motion(20e-3), drive_check(MACHINE, MODELS))
    plan(MACHINE, motion(24.5e-3), drive_check(MACHINE, MODELS))


@pytest.mark.parametrize('control', ['robust', 'computed_torque'])
def test_controllers_refuse_a_cycle_beyond_the_drive(control):
    joints = to_joints(MACHINE, plan(MACHINE, motion(20e-3)))
    controller = make_controller(MACHINE, choose_control(MACHINE, control))
    with pytest.raises(TrajectoryError, match='by its model; allowed 10 V'):
        controller.load(joints, np.zeros_like(joints.position))


def test_friction_is_part_of_the_needed_voltage():
    joints = to_joints(MACHINE, plan(MACHINE, motion(70e-3)))
    rough = MODELS['d1'].model_copy(update={'forces': Forces(coulomb=0.1, slip=10e-6, coupling=1.0)})
    more = np.abs(needed_voltage(MACHINE, rough, joints, 0)) - np.abs(needed_voltage(MACHINE, MODELS['d1'], joints, 0))
    assert np.abs(more).max() == pytest.approx(0.1, rel=1e-3)


def test_command_at_its_limit_is_noticed():
    """A feedforward beyond the limit for three samples; the axis moves by some micrometres."""
    joints, gains = to_joints(MACHINE, plan(MACHINE, motion(70e-3))), load_control(MACHINE)
    start = np.zeros_like(joints.position)
    start[5:8, 1] = 40.0
    notices = run_cycles(MACHINE, joints, gains, None, 1, seed=1, start=start).notices
    assert len(notices) == 1
    assert notices[0].startswith('cycle 1: d3: ')
    assert 'samples at the limit of 10 V' in notices[0]
    assert run_cycles(MACHINE, joints, gains, None, 1, seed=1).notices == ()
