"""Profiles, planning of motions, and the refusals on conversion to joints."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pkm_core.config import ConfigError, Configuration
from pkm_core.errors import TrajectoryError, WorkspaceError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import ArcTarget, Motion, Pose, Target, load_motion, plan, poses_motion
from pkm_core.motion.profiles import MotionLimits, limited_profile, unit_profile
from pkm_core.motion.trajectory import SampledTrajectory, to_joints

FOUR_DOF = load_machine('four_dof')
PLANAR = load_machine('planar')
DEFAULT = load_motion('four_dof_70ms')
MM = 1e-3
SHAPES = ('p7', 's3', 's4')
HOME = FOUR_DOF.forward(FOUR_DOF.home)
DIAGONAL = np.array([MM, MM, 0.0, 0.0])


def moved(by, **timing):
    return Motion(machine='four_dof', targets=(Target(by=by),), **timing)


@pytest.mark.parametrize('name', SHAPES)
def test_profile_goes_from_rest_at_0_to_rest_at_1(name):
    position, velocity, acceleration, _ = unit_profile(name, [0.0, 1.0])
    np.testing.assert_array_equal(position, [0.0, 1.0])
    np.testing.assert_array_equal(velocity, [0.0, 0.0])
    np.testing.assert_array_equal(acceleration, [0.0, 0.0])


@pytest.mark.parametrize('name', SHAPES)
def test_profile_is_symmetric(name):
    s = np.linspace(0, 1, 101)
    position, velocity, acceleration, _ = unit_profile(name, s)
    np.testing.assert_allclose(position + position[::-1], 1.0, atol=1e-13)
    np.testing.assert_allclose(velocity, velocity[::-1], atol=1e-12)
    np.testing.assert_allclose(acceleration, -acceleration[::-1], atol=1e-10)


@pytest.mark.parametrize('name', SHAPES)
def test_derivatives_of_a_profile_are_its_derivatives(name):
    s = np.linspace(0.003, 0.997, 401)
    for switch in (0.25, 0.75, *np.sin(np.pi / 8 * np.arange(1, 4)) ** 2):  # away from where s3 and s4 switch
        s = s[np.abs(s - switch) > 1e-4]
    h = 1e-5
    before, at, after = (unit_profile(name, s + step) for step in (-h, 0, h))
    for order in range(3):
        slope = (after[order] - before[order]) / (2 * h)
        # truncation: h^2/6 of the next but one derivative, at most 25200
        np.testing.assert_allclose(at[order + 1], slope, atol=2e-6)


@pytest.mark.parametrize('name', ['p7', 's4'])
def test_profile_of_bounded_snap_begins_and_ends_without_jerk(name):
    np.testing.assert_array_equal(unit_profile(name, [0.0, 1.0])[3], [0.0, 0.0])


def test_s4_switches_one_snap():
    jerk = unit_profile('s4', np.linspace(0, 1, 2001))[3]
    snap = np.diff(jerk) * 2000
    assert np.abs(snap).max() == pytest.approx(384, rel=1e-9)
    assert (np.abs(np.abs(snap) - 384) < 1e-6).sum() >= 1997  # except the three steps that contain a switch


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


def test_conversion_from_poses_keeps_the_profile_up_to_jerk():
    joints = to_joints(FOUR_DOF, plan(FOUR_DOF, DEFAULT))
    s = np.arange(141) / 140
    for order, derivative in enumerate(joints.derivatives()):
        expected = unit_profile('p7', s)[order][:, None] * np.array([5, 5, -4, 4]) * MM / 0.07**order
        offset = FOUR_DOF.home if order == 0 else 0.0
        # rounding of the mechanism's inverse, 1e-15 of the largest value
        np.testing.assert_allclose(derivative[40:181] - offset, expected, atol=1e-13 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize(
    'path', sorted((Configuration.of_environment().folder / 'motions').glob('*.yaml')), ids=lambda path: path.stem
)
def test_every_configured_motion_can_be_planned_and_returns_home(path):
    motion = load_motion(path)
    machine = load_machine(motion.machine)
    joints = to_joints(machine, plan(machine, motion))
    np.testing.assert_allclose(joints.position[[0, -1]], [machine.home, machine.home], atol=1e-12)


def test_poses_are_visited_in_order_and_the_end_is_home():
    poses = FOUR_DOF.forward(FOUR_DOF.home + np.array([[2, -3, 1, 4], [-5, 2, 6, -1]]) * MM)
    trajectory = plan(FOUR_DOF, poses_motion(FOUR_DOF, poses, 0.05))
    assert (trajectory.move_ends - trajectory.move_starts).tolist() == [100, 100, 100]
    home = FOUR_DOF.forward(FOUR_DOF.home)
    np.testing.assert_allclose(trajectory.position[trajectory.move_ends], [*poses, home], atol=1e-12)
    np.testing.assert_allclose(trajectory.position[0], home, atol=1e-12)


@pytest.mark.parametrize(('rest', 'samples'), [(None, 200), (0.15, 300)])
def test_rest_between_two_poses_has_the_given_duration(rest, samples):
    poses = PLANAR.forward(PLANAR.home + np.array([[2, -3], [-5, 2]]) * MM)
    trajectory = plan(PLANAR, poses_motion(PLANAR, poses, 0.05, rest))
    assert (trajectory.move_starts[1:] - trajectory.move_ends[:-1]).tolist() == [samples, samples]


@pytest.mark.parametrize('rest', [0.02, -1.0, np.nan, np.inf])
def test_rest_shorter_than_the_lead_is_refused(rest):
    with pytest.raises(TrajectoryError, match=r'rest time is .* s; expected more than 0.02 s'):
        poses_motion(PLANAR, [[0.1, 0.07]], 0.05, rest)


def test_poses_motion_has_the_default_move_time():
    assert poses_motion(PLANAR, [PLANAR.forward(PLANAR.home)]).move_time == 70e-3


@pytest.mark.parametrize(
    ('poses', 'move_time', 'reason'),
    [
        ([[0.09, np.nan]], 0.07, 'pose 0: y is nan'),
        ([[0.09, 0.09, 0.1]], 0.07, r'poses have shape \(1, 3\)'),
        (np.zeros((0, 2)), 0.07, r'poses have shape \(0, 2\)'),
        ([[0.1, 0.07]], -0.07, 'move time is -0.07 s'),
        ([[0.1, 0.07]], np.nan, 'move time is nan s'),
        (
            [[0.1, 0.07]],
            10.0,
            'move time is 10 s; with their rests the 2 moves of a cycle take 20.2 s; allowed up to 20 s',
        ),
        ([[0.1, 0.07]] * 150, None, 'move time is 0.07 s; with their rests the 151 moves of a cycle take 25.67 s'),
    ],
)
def test_unfit_poses_are_refused(poses, move_time, reason):
    with pytest.raises(TrajectoryError, match=reason):
        poses_motion(PLANAR, poses, move_time)


def test_too_long_a_motion_is_refused_with_its_duration(tmp_path):
    text = (
        (Configuration.of_environment().folder / 'motions' / 'planar_80ms.yaml')
        .read_text()
        .replace('move_time: 80 ms', 'move_time: 1 min')
    )
    (tmp_path / 'slow.yaml').write_text(text)
    with pytest.raises(ConfigError, match=r'slow.yaml: move time is 60 s; .* take 120.2 s; allowed up to 20 s'):
        load_motion(tmp_path / 'slow.yaml')


def test_target_out_of_reach_is_refused_with_its_number():
    with pytest.raises(WorkspaceError, match='target 1: '):
        plan(PLANAR, poses_motion(PLANAR, [PLANAR.forward(PLANAR.home), [0.1, 0.2]]))


def test_move_beyond_the_travel_is_refused_with_the_way_left():
    text = r'd1 may move by -20.00 to 20.00 mm \(d1 = 104.5 mm; allowed 59.5 to 99.5 mm'
    with pytest.raises(WorkspaceError, match=text):
        plan(FOUR_DOF, moved({'d1': 25 * MM}))


def test_too_fast_a_move_is_refused_with_sample_and_numbers():
    with pytest.raises(TrajectoryError, match=r'd3 at sample \d+ moves at 0\.8\d+ m/s; allowed 0.8 m/s'):
        plan(FOUR_DOF, moved({'d3': 20 * MM}, move_time=50e-3))  # peak 2.19 d/T = 0.875 m/s


def test_move_beyond_the_thrust_is_refused_with_sample_and_force():
    with pytest.raises(TrajectoryError, match=r'd\d at sample \d+ needs 1\d\d\.\d N; allowed 110\.\d+ N'):
        plan(FOUR_DOF, moved({'d1': 5 * MM, 'd3': 5 * MM, 'd5': 5 * MM, 'd7': 5 * MM}, move_time=15e-3))


@pytest.mark.parametrize('name', SHAPES)
@pytest.mark.parametrize('order', [1, 2, 3, 4])
def test_limited_move_reaches_and_keeps_its_limit(name, order):
    """Within one sample of the duration."""
    limited = ('speed', 'acceleration', 'jerk', 'snap')[order - 1]
    limits = MotionLimits(**{limited: {1: 0.2, 2: 5.0, 3: 500.0, 4: 1e5}[order]})
    if (name, limited) == ('s3', 'snap'):
        with pytest.raises(TrajectoryError, match='snap: profile s3 has no bounded snap'):
            limited_profile(name, limits, 0.01, 0.5e-3, 20.0)
        return
    samples, _ = limited_profile(name, limits, 0.01, 0.5e-3, 20.0)
    fine = unit_profile(name, np.linspace(0, 1, 4001))
    derivative = np.diff(fine[3]) * 4000 if order == 4 else fine[order]

    def peak(samples):
        return np.abs(derivative).max() * 0.01 / (samples * 0.5e-3) ** order

    # 4000 samples miss a smooth peak by up to 1e-6, and the snap of p7 at its end by 3e-3
    assert peak(samples) <= getattr(limits, limited) * (1 + 1e-9)
    assert peak(samples - 1) > getattr(limits, limited) * (1 - 4e-3)


def test_ruckig_keeps_three_limits_and_reaches_them_if_long():
    limits = MotionLimits(speed=0.1, acceleration=5.0, jerk=500.0)
    motion = moved({'d1': 15 * MM, 'd3': -3 * MM}, profile='ruckig', limits=limits)
    joints = to_joints(FOUR_DOF, plan(FOUR_DOF, motion))
    for derivative, limit in zip(joints.derivatives()[1:], (0.1, 5.0, 500.0), strict=True):
        # rounding up to whole samples lengthens the move by less than 1 in 300
        assert 0.98 * limit < np.abs(derivative[:, 0]).max() <= limit * (1 + 1e-9)
        np.testing.assert_allclose(derivative[:, 1], -0.2 * derivative[:, 0], atol=1e-9 * limit)  # synchronised
    np.testing.assert_allclose(joints.position[joints.move_ends[0]] - FOUR_DOF.home, [0.015, -0.003, 0, 0], atol=1e-12)


def test_derivatives_of_a_ruckig_move_are_its_derivatives():
    limits = MotionLimits(speed=0.1, acceleration=5.0, jerk=500.0)
    samples, profile = limited_profile('ruckig', limits, 0.01, 0.5e-3, 20.0)
    for lower, higher in pairwise(profile[:3]):
        slope = np.diff(lower) * samples
        # error of the trapezoidal rule: the step of the next derivative over 8 samples
        tolerance = np.abs(np.diff(higher)).max() / 8 + 1e-9
        np.testing.assert_allclose((higher[1:] + higher[:-1]) / 2, slope, atol=tolerance)


def test_line_is_straight_in_all_coordinates():
    end = HOME + np.array([1.5 * MM, -1.0 * MM, -0.3 * MM, 0.02])
    line = Target(line=Pose(**dict(zip(FOUR_DOF.coordinates, end.tolist(), strict=True))))
    trajectory = plan(FOUR_DOF, Motion(machine='four_dof', targets=(line,)))
    share = (trajectory.position[40:181] - HOME) / (end - HOME)
    expected = np.repeat(unit_profile('p7', np.arange(141) / 140)[0][:, None], 4, axis=1)
    np.testing.assert_allclose(share, expected, atol=1e-10)  # rounding of the mechanism over the shortest change
    speed = trajectory.velocity[40:181] / (end - HOME)
    np.testing.assert_allclose(speed, np.repeat(speed[:, :1], 4, axis=1), atol=1e-8)


def arc(via, to, machine='four_dof', **timing):
    names = ('x', 'y', 'z', 'phi')
    target = ArcTarget(via=Pose(**dict(zip(names, via, strict=False))), to=Pose(**dict(zip(names, to, strict=False))))
    return Motion(machine=machine, targets=(Target(arc=target),), **timing)


def test_arc_keeps_its_radius_and_passes_its_via_point():
    """phi changes in proportion to the path."""
    x, y, z, phi = HOME
    motion = arc([x + 1 * MM, y - 1 * MM, z], [x + 2 * MM, y, z, phi + 0.02])  # half a circle of 1 mm, below
    trajectory = plan(FOUR_DOF, motion)
    moving = trajectory.position[40:181]
    radius = np.linalg.norm(moving[:, :3] - [x + 1 * MM, y, z], axis=1)
    np.testing.assert_allclose(radius, 1 * MM, atol=1e-13)
    np.testing.assert_allclose(moving[70, :3], [x + 1 * MM, y - 1 * MM, z], atol=1e-13)  # p7 is half way at half time
    angle = np.arctan2(moving[:, 1] - y, moving[:, 0] - x - 1 * MM)
    np.testing.assert_allclose(angle[1:-1] + np.pi, np.pi * (moving[1:-1, 3] - phi) / 0.02, atol=1e-8)


def test_arc_of_a_plane_machine_may_be_more_than_half_a_circle():
    x, y = PLANAR.forward(PLANAR.home)
    trajectory = plan(PLANAR, arc([x, y - 2 * MM], [x + 1 * MM, y - 1 * MM], machine='planar'))
    moving = trajectory.position[40:181]
    np.testing.assert_allclose(np.linalg.norm(moving - [x, y - 1 * MM], axis=1), 1 * MM, atol=1e-13)
    assert moving[:, 0].min() == pytest.approx(x - 1 * MM, abs=1e-6)  # the longer way: start, left, via, end
    speed = np.linalg.norm(trajectory.velocity[40:181], axis=1)
    assert speed.max() == pytest.approx(35 / 16 * 1.5 * np.pi * MM / 70e-3, rel=1e-4)


def test_path_that_leaves_the_workspace_is_refused_by_its_target():
    x, y, z, phi = HOME
    with pytest.raises(WorkspaceError, match='motion: target 0: '):
        plan(FOUR_DOF, arc([x + 30 * MM, y + 30 * MM, z], [x + 1 * MM, y, z, phi]))


def test_motion_that_ends_at_home_has_no_return_move():
    there, back = Target(by={'d1': 2 * MM}), Target(by={'d1': -2 * MM})
    trajectory = plan(FOUR_DOF, Motion(machine='four_dof', targets=(there, back)))
    assert len(trajectory.move_ends) == 2


def test_limits_give_each_move_the_time_of_its_length():
    targets = (Target(by={'d1': 1 * MM}), Target(by={'d1': 15 * MM}))
    motion = Motion(machine='four_dof', targets=targets, limits=MotionLimits(acceleration=5.0))
    trajectory = plan(FOUR_DOF, motion)
    times = trajectory.move_ends - trajectory.move_starts
    assert times.tolist() == [78, 301, 311]  # sqrt(7.513 d/a)/Ts, rounded up


@pytest.mark.parametrize(
    ('motion', 'reason'),
    [
        (arc([*HOME[:3], 0.1], HOME), r"target 0: via: names .*'phi'.*; expected"),
        (arc(HOME[:3] + 0.5 * DIAGONAL[:3], HOME + DIAGONAL), 'target 0: start, via and end of the arc'),
        (moved({}, limits=MotionLimits(speed=0.1)), 'target 0: no length changes'),
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
        ('targets: [{}]', "exactly one of 'by'"),
        ('targets: [{by: {d1: 5 mm}, line: {x: 90 mm, y: 90 mm}}]', "exactly one of 'by'"),
        ('targets: [{by: {d1: 5 mm}}]\nmove_time: 70 ms\nlimits: {speed: 0.1 m/s}', "both 'move_time' and 'limits'"),
        ('targets: [{by: {d1: 5 mm}}]\nlimits: {}', 'at least one of'),
        ('targets: [{by: {d1: 5 mm}}]\nlimits: {jerk: 5 m/s^2}', 'limits.jerk'),
        (
            'targets: [{by: {d1: 5 mm}}]\nprofile: ruckig',
            "'ruckig' takes exactly the limits speed, acceleration and jerk",
        ),
        ('targets: [{by: {d1: 5 mm}}]\nmove_time: 0 s', 'move_time'),
        ('targets: [{by: {d1: 5 mm}}]\nprofile: p5', 'profile'),
    ],
)
def test_unfit_motion_file_is_refused(tmp_path, line, reason):
    path = tmp_path / 'motion.yaml'
    path.write_text(f'machine: four_dof\n{line}\n')
    with pytest.raises(ConfigError, match=reason):
        load_motion(path)


def test_value_that_is_not_finite_is_refused_with_its_sample():
    """The coordinate is named too."""
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
    with pytest.raises(
        WorkspaceError, match=r'sample 321: x 114.746 mm, .* out of reach; there x may go from 78.75 to 99.03 mm'
    ):
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
