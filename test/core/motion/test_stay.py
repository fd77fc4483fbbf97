"""Motions that stay, where the next cycle begins, and moves to a pose."""

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError, TrajectoryError, WorkspaceError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import Motion, Target, plan, poses_motion
from pkm_core.motion.point_to_point import pose_target, way_to
from pkm_core.motion.standing import NEAR, Standing
from pkm_core.motion.trajectory import checked_cycle, to_joints
from pkm_core.simulation.cycles import run_cycles

MACHINE = load_machine('planar')
HOME = MACHINE.home
AWAY = HOME + np.array([2e-3, 1e-3])
UM = 1e-6


def moved(**fields):
    return Motion(machine='planar', targets=(Target(by={'d1': 1e-3}),), **fields)


def joints_of(motion, start=None):
    return to_joints(MACHINE, plan(MACHINE, motion, start=start))


def test_stay_begins_at_the_start_and_ends_at_the_target():
    joints = joints_of(moved(stay=True), AWAY)
    np.testing.assert_allclose(joints.position[0], AWAY, atol=1e-12)
    np.testing.assert_allclose(joints.position[-1], AWAY + np.array([1e-3, 0.0]), atol=1e-12)
    assert len(joints.move_starts) == 1
    assert not joints.velocity[[0, -1]].any()


def test_motion_without_stay_is_refused_away_from_home():
    text = 'begins and ends at home; the machine stands elsewhere, d1 by 2 mm; call the action home first, or give stay'
    with pytest.raises(TrajectoryError, match=text):
        plan(MACHINE, moved(), start=AWAY)


def test_poses_that_stay_have_no_way_home():
    """One pose more fits into the longest cycle than with the way home."""
    pose = MACHINE.forward(AWAY)
    assert len(poses_motion(MACHINE, [pose] * 20, 0.9, stay=True).targets) == 20
    with pytest.raises(TrajectoryError, match='the 21 moves of a cycle take 21 s'):
        poses_motion(MACHINE, [pose] * 20, 0.9)


def test_simulation_refuses_to_repeat_a_motion_that_stays():
    joints, gains = joints_of(moved(stay=True)), load_control(MACHINE)
    with pytest.raises(PkmError, match='2 of a motion that ends elsewhere than where it begins; allowed: 1'):
        run_cycles(MACHINE, joints, gains, None, 2, 1)
    assert np.abs(run_cycles(MACHINE, joints, gains, None, 1, 1).error).max() < 50 * UM


def test_cycle_begins_where_the_one_before_has_ended():
    standing = Standing(MACHINE)
    first = standing.check(joints_of(moved(stay=True)), stay=True)
    standing.ended(1, first.position[-1])
    standing.check(joints_of(moved(stay=True), standing.position), stay=True)
    with pytest.raises(TrajectoryError, match='d1 is -1 mm from where the machine stands at the first sample; allowed'):
        standing.check(joints_of(moved()))


def test_cycle_without_stay_ends_where_it_begins():
    with pytest.raises(TrajectoryError, match='d1 is 1 mm from home at the last sample; allowed 1 um'):
        checked_cycle(MACHINE, joints_of(moved(stay=True)))
    away = joints_of(moved(stay=True), AWAY)
    with pytest.raises(TrajectoryError, match='d1 is 1 mm from where the machine stands at the last sample'):
        checked_cycle(MACHINE, away, AWAY)


def test_standing_is_exactly_home_after_a_cycle_that_returns():
    standing = Standing(MACHINE)
    standing.ended(3, HOME + 1e-12)
    assert standing.position is MACHINE.home
    assert standing.is_at_home


def test_encoders_replace_the_reference_only_if_they_differ():
    """A standing axis is off by micrometres; a reset or a restarted node by more than `NEAR`."""
    standing = Standing(MACHINE)
    standing.ended(1, AWAY)
    standing.reported(1, MACHINE.joints, AWAY + 0.5 * NEAR)
    np.testing.assert_array_equal(standing.position, AWAY)
    standing.reported(1, MACHINE.joints, HOME + 2 * UM)
    assert standing.is_at_home
    standing.reported(0, MACHINE.joints, AWAY)
    np.testing.assert_array_equal(standing.position, AWAY)
    standing.reset()
    assert standing.is_at_home


@pytest.mark.parametrize(
    ('cycle', 'joints', 'position'),
    [
        (1, MACHINE.joints, AWAY),
        (2, ('x', 'y'), AWAY),
        (2, MACHINE.joints, [0.1]),
        (2, MACHINE.joints, [np.nan, 0.1]),
    ],
)
def test_late_or_malformed_report_is_ignored(cycle, joints, position):
    standing = Standing(MACHINE)
    standing.ended(2, HOME)
    standing.reported(cycle, joints, position)
    assert standing.is_at_home


def test_pose_target_keeps_the_coordinates_that_are_not_named():
    x, y = MACHINE.forward(AWAY)
    there = MACHINE.forward(pose_target(MACHINE, AWAY, {'x': x + 1e-3, 'y': 9.0, 'z': 9.0}, ['x']))
    np.testing.assert_allclose(there, [x + 1e-3, y], atol=1e-12)
    there = MACHINE.forward(pose_target(MACHINE, AWAY, {'x': 1e-3, 'y': -1e-3}, relative=True))
    np.testing.assert_allclose(there, [x + 1e-3, y - 1e-3], atol=1e-12)


@pytest.mark.parametrize(
    ('values', 'names', 'text'),
    [
        ({'x': 0.1, 'y': 0.1}, ['w'], r"go_to: coordinates \['w'\]; allowed: each of \['x', 'y'\] once"),
        ({'x': 0.1, 'y': 0.1}, ['x', 'x'], 'once, or none for all'),
        ({'x': np.nan, 'y': 0.1}, [], 'go_to: x is nan; expected a finite number'),
        ({'x': 0.1, 'y': 0.1, 'z': 0.2}, [], 'go_to: z is 0.2 m; planar has no z, expected 0'),
        ({'x': 1.0, 'y': 0.0}, ['x'], r'go_to: x 1000 mm, y \S+ mm is out of reach; there x may go from \S+ to \S+ mm'),
    ],
)
def test_pose_target_is_refused(values, names, text):
    with pytest.raises(PkmError, match=text):
        pose_target(MACHINE, HOME, values, names)


def test_move_takes_longer_if_the_default_is_too_short():
    near, far = MACHINE.limits.lower + 1e-3, MACHINE.limits.upper - 1e-3
    way = way_to(MACHINE, near, far)
    shortest = (way.move_ends[0] - way.move_starts[0]) * MACHINE.sample_time
    assert shortest > 70e-3
    with pytest.raises(TrajectoryError, match=f'shortest allowed move_time: {shortest * 1e3:g} ms'):
        way_to(MACHINE, near, far, 70e-3)
    np.testing.assert_allclose(to_joints(MACHINE, way).position[-1], far, atol=1e-9)


@pytest.mark.parametrize('time', [-0.1, np.nan, np.inf])
def test_move_time_must_be_positive_and_finite(time):
    with pytest.raises(TrajectoryError, match=r'move time is .* s; expected a positive number'):
        way_to(MACHINE, HOME, AWAY, time)


def test_home_is_reached_exactly():
    way = to_joints(MACHINE, way_to(MACHINE, AWAY, HOME))
    standing = Standing(MACHINE)
    standing.ended(1, way.position[-1])
    assert standing.is_at_home


def test_unreachable_displacement_names_the_way_that_is_left():
    with pytest.raises(WorkspaceError, match=r'by d1 500 mm, d3 0 mm is out of reach; d1 may move by -?\d'):
        plan(MACHINE, Motion(machine='planar', targets=(Target(by={'d1': 0.5}),)))
