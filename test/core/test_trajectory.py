"""Profiles, the planning of motions, and what is refused on the way to the joints."""

from dataclasses import replace

import numpy as np
import pytest

from pkm_core.config import ConfigError, config_folder
from pkm_core.errors import TrajectoryError, WorkspaceError
from pkm_core.machines import load_machine
from pkm_core.motions import Motion, Target, load_motion, plan, poses_motion
from pkm_core.trajectory import PROFILES, SampledTrajectory, to_joints, unit_profile

FOUR_DOF = load_machine('four_dof')
PLANAR = load_machine('planar')
DEFAULT = load_motion('four_dof_70ms')
MM = 1e-3


def moved(by, **timing):
    return Motion(machine='four_dof', targets=(Target(by=by),), **timing)


@pytest.mark.parametrize('name', PROFILES)
def test_profile_goes_from_rest_at_0_to_rest_at_1(name):
    position, velocity, acceleration, _ = unit_profile(name, [0.0, 1.0])
    np.testing.assert_array_equal(position, [0.0, 1.0])
    np.testing.assert_array_equal(velocity, [0.0, 0.0])
    np.testing.assert_array_equal(acceleration, [0.0, 0.0])


@pytest.mark.parametrize('name', PROFILES)
def test_profile_is_symmetric(name):
    s = np.linspace(0, 1, 101)
    position, velocity, acceleration, _ = unit_profile(name, s)
    np.testing.assert_allclose(position + position[::-1], 1.0, atol=1e-13)
    np.testing.assert_allclose(velocity, velocity[::-1], atol=1e-12)
    np.testing.assert_allclose(acceleration, -acceleration[::-1], atol=1e-10)


@pytest.mark.parametrize('name', PROFILES)
def test_derivatives_of_a_profile_are_its_derivatives(name):
    s = np.linspace(0.003, 0.997, 401)
    s = s[np.abs(4 * s - np.round(4 * s)) > 1e-3]  # away from where s3 switches its jerk
    h = 1e-5
    before, at, after = (unit_profile(name, s + step) for step in (-h, 0, h))
    for order in range(3):
        slope = (after[order] - before[order]) / (2 * h)
        # truncation: h^2/6 of the next but one derivative, at most 25200
        np.testing.assert_allclose(at[order + 1], slope, atol=2e-6)


def test_p7_begins_and_ends_without_jerk():
    np.testing.assert_array_equal(unit_profile('p7', [0.0, 1.0])[3], [0.0, 0.0])


def test_s3_switches_one_jerk():
    np.testing.assert_array_equal(unit_profile('s3', [0.0, 0.24, 0.26, 0.74, 0.76, 1.0])[3], [32, 32, -32, -32, 32, 0])


def test_default_cycle_has_the_documented_timing():
    joints = to_joints(FOUR_DOF, plan(FOUR_DOF, DEFAULT))
    assert len(joints) == 680
    assert joints.move_starts.tolist() == [40, 380]
    assert joints.move_ends.tolist() == [180, 520]
    offset = (joints.position - FOUR_DOF.home) / MM
    for sample, expected in ((0, 0), (40, 0), (180, 1), (380, 1), (520, 0), (679, 0)):
        np.testing.assert_allclose(offset[sample], expected * np.array([5, 5, -4, 4]), atol=1e-9)
    assert not joints.velocity[180:380].any()
    assert not joints.velocity[520:].any()


def test_way_through_poses_keeps_the_joint_profile_up_to_the_jerk():
    joints = to_joints(FOUR_DOF, plan(FOUR_DOF, DEFAULT))
    s = np.arange(141) / 140
    for order, derivative in enumerate(joints.derivatives()):
        expected = unit_profile('p7', s)[order][:, None] * np.array([5, 5, -4, 4]) * MM / 0.07**order
        offset = FOUR_DOF.home if order == 0 else 0.0
        # rounding of the mechanism's inverse, 1e-15 of the largest value
        np.testing.assert_allclose(derivative[40:181] - offset, expected, atol=1e-13 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize('path', sorted((config_folder() / 'motions').glob('*.yaml')), ids=lambda path: path.stem)
def test_every_configured_motion_can_be_planned_and_returns_home(path):
    motion = load_motion(path)
    machine = load_machine(motion.machine)
    joints = to_joints(machine, plan(machine, motion))
    np.testing.assert_allclose(joints.position[[0, -1]], [machine.home, machine.home], atol=1e-12)


def test_poses_are_visited_in_order_and_home_is_the_end():
    poses = FOUR_DOF.forward(FOUR_DOF.home + np.array([[2, -3, 1, 4], [-5, 2, 6, -1]]) * MM)
    trajectory = plan(FOUR_DOF, poses_motion(FOUR_DOF, poses, 0.05))
    assert (trajectory.move_ends - trajectory.move_starts).tolist() == [100, 100, 100]
    home = FOUR_DOF.forward(FOUR_DOF.home)
    np.testing.assert_allclose(trajectory.position[trajectory.move_ends], [*poses, home], atol=1e-12)
    np.testing.assert_allclose(trajectory.position[0], home, atol=1e-12)


def test_poses_motion_takes_the_default_move_time_when_none_is_given():
    assert poses_motion(PLANAR, [PLANAR.forward(PLANAR.home)]).move_time == 70e-3


@pytest.mark.parametrize(
    ('poses', 'move_time', 'reason'),
    [
        ([[0.09, np.nan]], 0.07, 'pose 0: y is nan'),
        ([[0.09, 0.09, 0.1]], 0.07, r'poses have shape \(1, 3\)'),
        (np.zeros((0, 2)), 0.07, r'poses have shape \(0, 2\)'),
        ([[0.1, 0.07]], -0.07, 'move time is -0.07 s'),
        ([[0.1, 0.07]], np.nan, 'move time is nan s'),
    ],
)
def test_unfit_poses_are_refused(poses, move_time, reason):
    with pytest.raises(TrajectoryError, match=reason):
        poses_motion(PLANAR, poses, move_time)


def test_target_outside_the_workspace_is_refused_by_its_number():
    with pytest.raises(WorkspaceError, match='target 1: '):
        plan(PLANAR, poses_motion(PLANAR, [PLANAR.forward(PLANAR.home), [0.1, 0.2]]))


def test_joint_leaving_its_travel_is_refused_with_sample_and_numbers():
    with pytest.raises(WorkspaceError, match=r'row \d+: d1 = 99\.\d+ mm; allowed 59.5 to 99.5 mm'):
        plan(FOUR_DOF, moved({'d1': 25 * MM}))


def test_too_fast_a_move_is_refused_with_sample_and_numbers():
    with pytest.raises(TrajectoryError, match=r'd3 at sample \d+ moves at 0\.8\d+ m/s; allowed 0.8 m/s'):
        plan(FOUR_DOF, moved({'d3': 20 * MM}, move_time=50e-3))  # peak 2.19 d/T = 0.875 m/s


@pytest.mark.parametrize(
    ('motion', 'reason'),
    [
        (moved({'d1': MM}, move_time=70.2e-3), 'move_time is 70.2 ms; expected a multiple of 0.5 ms'),
        (moved({'d2': MM}), r"target 0: names \['d2'\]; known: \['d1', 'd3', 'd5', 'd7'\]"),
        (load_motion('planar_80ms'), 'motion is for planar; the machine is four_dof'),
        (
            Motion(machine='four_dof', targets=(Target(pose={'x': 0.09, 'y': 0.09}),)),
            r"target 0: names \['x', 'y'\]; expected \['x', 'y', 'z', 'phi'\]",
        ),
    ],
)
def test_unfit_motion_is_refused(motion, reason):
    with pytest.raises(TrajectoryError, match=reason):
        plan(FOUR_DOF, motion)


@pytest.mark.parametrize(
    ('line', 'reason'),
    [
        ('targets: []', 'targets'),
        ('targets: [{by: {d1: 5}}]', 'no unit'),
        ('targets: [{}]', "either 'by'"),
        ('targets: [{by: {d1: 5 mm}}]\nmove_time: 0 s', 'move_time'),
        ('targets: [{by: {d1: 5 mm}}]\nprofile: p5', 'profile'),
    ],
)
def test_unfit_motion_file_is_refused(tmp_path, line, reason):
    path = tmp_path / 'motion.yaml'
    path.write_text(f'machine: four_dof\n{line}\n')
    with pytest.raises(ConfigError, match=reason):
        load_motion(path)


def test_value_that_is_not_finite_is_refused_with_sample_and_coordinate():
    trajectory = plan(FOUR_DOF, DEFAULT)
    position = trajectory.position.copy()
    position[17, 2] = np.nan
    with pytest.raises(TrajectoryError, match='position of z at sample 17 is nan'):
        replace(trajectory, position=position)


@pytest.mark.parametrize(
    ('starts', 'ends'),
    [([], []), ([40], [40]), ([40], [680]), ([40, 100], [180, 240]), ([1, 2], [9])],
)
def test_moves_that_do_not_fit_the_cycle_are_refused(starts, ends):
    with pytest.raises(TrajectoryError, match='moves from samples'):
        replace(plan(FOUR_DOF, DEFAULT), move_starts=np.array(starts), move_ends=np.array(ends))


def test_pose_outside_the_workspace_is_refused_with_its_sample():
    trajectory = plan(FOUR_DOF, DEFAULT)
    position = trajectory.position.copy()
    position[321, 0] += 20 * MM
    with pytest.raises(WorkspaceError, match='row 321'):
        to_joints(FOUR_DOF, replace(trajectory, position=position))


def test_trajectory_of_another_machine_or_rate_is_refused():
    trajectory = plan(FOUR_DOF, DEFAULT)
    with pytest.raises(TrajectoryError, match='coordinates'):
        to_joints(PLANAR, trajectory)
    with pytest.raises(TrajectoryError, match=r'sample time 1 ms; four_dof runs at 0\.5 ms'):
        to_joints(FOUR_DOF, replace(trajectory, sample_time=1e-3))


def test_derivative_of_another_shape_is_refused():
    column = np.zeros((10, 1))
    with pytest.raises(TrajectoryError, match='jerk has shape'):
        SampledTrajectory(0.5e-3, ('x',), column, column, column, column[:9], np.array([1]), np.array([2]))
