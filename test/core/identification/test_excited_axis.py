"""Requests of an identification and excitation of an axis: refused before the motion, bounded during it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.identification.excitation import experiments
from pkm_core.identification.excited_axis import ExcitedAxis
from pkm_core.identification.plan import Request, in_poses, plan
from pkm_core.machines import load_machine
from pkm_core.motion.trajectory import to_joints

JOINT, COLUMN = 'd3', 1


@pytest.fixture(scope='module')
def planar():
    return load_machine('planar')


def planned(machine, **wanted):
    return plan(machine, Request(**wanted), load_model(machine), load_control(machine))


@pytest.fixture(scope='module')
def sweep(planar):
    return planned(planar, joints=(JOINT,), kind='sweep', positions=1)[JOINT][0]


def excited(machine, sweep, *, column=COLUMN, volts=None):
    joint = machine.joints[column]
    rows = (getattr(sweep.trajectory, name)[:, column] for name in ('position', 'velocity', 'acceleration'))
    return ExcitedAxis(
        machine,
        joint,
        load_model(machine)[joint],
        load_control(machine)[joint],
        *rows,
        sweep.excitation[:, column] if volts is None else volts,
    )


def test_empty_request_plans_the_default_experiments(planar):
    models, gains = load_model(planar), load_control(planar)
    for joint, found in planned(planar).items():
        expected = experiments(planar, joint, models, gains)
        assert [each.name for each in found] == [each.name for each in expected]
        for ours, theirs in zip(found, expected, strict=True):
            assert np.array_equal(ours.trajectory.position, theirs.trajectory.position)
            assert np.array_equal(ours.excitation, theirs.excitation)


def test_kinds_and_positions_choose_the_experiments(planar):
    names = {kind: [e.name for e in planned(planar, joints=('d1',), kind=kind, positions=2)['d1']]
             for kind in ('low_frequency', 'sweep', 'both')}  # fmt: skip
    assert names == {
        'low_frequency': ['d1_slow_moves'],
        'sweep': ['d1_sweep_0', 'd1_sweep_1'],
        'both': ['d1_slow_moves', 'd1_sweep_0', 'd1_sweep_1'],
    }


def test_stroke_and_jog_speed_are_those_requested(planar):
    moves, jog = planned(planar, joints=('d1',), positions=1, stroke=3e-3, jog_speed=12e-3)['d1']
    path = moves.trajectory.position[:, 0]
    assert np.abs(path[moves.trajectory.move_ends] - path[moves.trajectory.move_starts]) == pytest.approx(3e-3)
    assert np.abs(jog.trajectory.velocity[jog.excitation[:, 0] != 0, 0]) == pytest.approx(12e-3)


@pytest.mark.parametrize(
    ('wanted', 'reason'),
    [
        ({'joints': ('d2',)}, r"joint 'd2' is unknown; planar has \['d1', 'd3'\]"),
        ({'joints': ('d1', 'd1')}, 'a name is repeated'),
        ({'kind': 'everything'}, "kind 'everything'; known"),
        ({'positions': 21}, 'positions: 21; allowed up to 20'),
        ({'band': (80.0, 1500.0)}, 'sweep from 80 to 1500 Hz; expected 0 < from < to < 1000 Hz'),
        ({'band': (0.0, 500.0)}, 'sweep from 0 to 500 Hz; expected 0 < from'),
        ({'band': (80.0, math.nan)}, 'band: nan Hz given'),
        ({'voltage': -1.0}, 'voltage: -1.0 V given; expected a finite number from 0'),
        ({'stroke': math.inf}, 'stroke: inf m given; expected a finite number from 0'),
        ({'stroke': 0.05}, r'd1: a stroke of 50\.0 mm leaves the travel; allowed 39\.0 mm'),
        ({'stroke': 0.03}, r'd1 at sample \d+ moves at \d\.\d+ m/s; allowed 0\.8 m/s'),
        ({'jog_speed': 0.2}, r'a stroke of \d+\.\d mm leaves the travel; allowed \d+\.\d mm'),
    ],
)
def test_infeasible_request_is_refused(planar, wanted, reason):
    with pytest.raises(PkmError, match=reason):
        planned(planar, **wanted)


def test_poses_of_an_experiment_convert_back_to_its_joints(planar, sweep):
    joints = to_joints(planar, in_poses(planar, sweep.trajectory))
    # rounding of a square root and its inverse at 0.1 m
    np.testing.assert_allclose(joints.position, sweep.trajectory.position, atol=1e-15)


def test_excitation_is_added_to_the_controller_voltage(planar, sweep):
    axis = excited(planar, sweep)
    index = int(np.abs(sweep.excitation[:, COLUMN]).argmax())
    volts, where = sweep.excitation[index, COLUMN], sweep.trajectory.position[index, COLUMN]
    assert axis.drive(index, 0.25, where) == 0.25 + volts
    idle = excited(planar, sweep, column=0)
    assert idle.drive(0, 0.25, sweep.trajectory.position[0, 0]) == 0.25


@pytest.mark.parametrize(
    ('voltage', 'offset', 'reason'),
    [
        (0.0, 2e-3, r'sample 5: d3 is 2\.000 mm off its reference; allowed 1 mm'),
        (9.0, 0.0, r'sample 5: d3 gets 9\.00 V; allowed \d\.\d\d V'),
        (0.0, 1.0, r'sample 5: d3 is at \d+\.\d+ mm; allowed'),
    ],
)
def test_axis_outside_its_bounds_is_stopped(planar, sweep, voltage, offset, reason):
    """The message holds sample, value and bound."""
    with pytest.raises(PkmError, match=reason):
        excited(planar, sweep).drive(5, voltage, sweep.trajectory.position[5, COLUMN] + offset)


def test_axis_above_its_speed_bound_is_stopped(planar, sweep):
    axis, position = excited(planar, sweep), sweep.trajectory.position[:, COLUMN]
    for index in range(8):  # from 0.9 mm below its reference to 0.9 mm above it in 4 ms
        axis.drive(index, 0.0, position[index] + 2.25e-4 * (index - 4))
    with pytest.raises(PkmError, match=r'd3 moves at 0\.\d+ m/s; allowed'):
        axis.drive(8, 0.0, position[8] + 2.25e-4 * 4)


@pytest.mark.parametrize(
    ('volts', 'reason'),
    [
        (lambda v: v[:-1], r'excitation of d3: \d+ values; expected one per sample, \d+'),
        (lambda v: np.where(np.arange(v.size) == 7, np.nan, v), 'excitation of d3: nan V at sample 7'),
        (lambda v: 20 * v, r'excitation of d3: would need \d+\.\d V; allowed 10 V'),
    ],
)
def test_invalid_excitation_is_refused_before_the_cycle(planar, sweep, volts, reason):
    with pytest.raises(PkmError, match=reason):
        excited(planar, sweep, volts=volts(sweep.excitation[:, COLUMN]))


def test_excited_cycle_above_the_speed_limit_is_refused(planar, sweep):
    nearly = np.full_like(sweep.trajectory.velocity, 0.99 * planar.limits.speed)
    fast = replace(sweep.trajectory, velocity=nearly)
    with pytest.raises(PkmError, match=r'would move at \d+\.\d+ m/s; allowed'):
        excited(planar, replace(sweep, trajectory=fast))
