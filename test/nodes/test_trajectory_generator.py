"""Node trajectory_generator: goals of execute_motion that run and goals that are refused."""

import math

import numpy as np
import pytest
from action_msgs.msg import GoalStatus

from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import DERIVATIVES
from pkm_interfaces.msg import PlatformPose
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from support.goals import JOINTS, MOTION, NEAR_HOME, pose_at

BEYOND_TRAVEL = pose_at([0.0590, 0.1395, 0.1395, 0.0795])  # d1 begins at 59.5 mm
BELOW_THE_TABLE = PlatformPose(x=NEAR_HOME.x, y=NEAR_HOME.y, z=-0.05, phi=NEAR_HOME.phi)
NAN = PlatformPose(x=NEAR_HOME.x, y=NEAR_HOME.y, z=math.nan, phi=NEAR_HOME.phi)


def test_configured_motion_runs_its_cycles(graph, goals, stand_in, machine):
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION, cycles=3, learning_law='fourier')
    sent = [stand_in.run(cycle) for cycle in (1, 2, 3)]
    status, result = goals.result(goal)
    assert (status, result.cycles_completed, result.message) == (GoalStatus.STATUS_SUCCEEDED, 3, '')
    expected = plan(machine, load_motion(MOTION))
    for message in sent:
        assert (message.motion, message.learning_law) == (MOTION, 'fourier')
        assert message.sample_time == machine.sample_time
        assert tuple(message.coordinates) == machine.coordinates
        assert list(message.move_starts) == list(expected.move_starts)
        assert list(message.move_ends) == list(expected.move_ends)
        for name in DERIVATIVES:
            assert np.array_equal(np.array(getattr(message, name)).reshape(-1, 4), getattr(expected, name))


def test_every_cycle_gives_feedback_of_all_joints(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION, cycles=2)
    for cycle in (1, 2):
        stand_in.run(cycle)
    goals.result(goal)
    graph.spin_until(lambda: len(goals.feedback) == 2, 'the feedback of two cycles')
    assert [feedback.cycle for feedback in goals.feedback] == [1, 2]
    assert goals.feedback[0].joints == list(JOINTS)
    assert list(goals.feedback[0].max_dynamic_error) == [1e-6, 2e-6, 3e-6, 4e-6]


def test_joint_without_metrics_has_nan_feedback(graph, goals, stand_in):
    """The goal succeeds after `metrics_timeout`."""
    graph.start(TrajectoryGeneratorNode, metrics_timeout=0.1)
    goal = goals.send(motion=MOTION)
    stand_in.start(1)
    stand_in.finish(1, errors=(1e-6, 2e-6, 3e-6))
    status, _ = goals.result(goal)
    assert status == GoalStatus.STATUS_SUCCEEDED
    graph.spin_until(lambda: goals.feedback, 'feedback')
    assert list(goals.feedback[0].max_dynamic_error)[:3] == [1e-6, 2e-6, 3e-6]
    assert math.isnan(goals.feedback[0].max_dynamic_error[3])


def test_goal_does_not_wait_for_a_controller_without_metrics(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode, metrics_timeout=1e6)
    graph.node.destroy_publisher(stand_in._metrics['d7'])
    goal = goals.send(motion=MOTION)
    stand_in.start(1)
    stand_in.finish(1, errors=(1e-6, 2e-6, 3e-6))
    status, _ = goals.result(goal)
    assert status == GoalStatus.STATUS_SUCCEEDED
    graph.spin_until(lambda: goals.feedback, 'feedback')
    assert math.isnan(goals.feedback[0].max_dynamic_error[3])


def test_poses_are_visited_from_home_and_back(graph, goals, stand_in, machine):
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(poses=[NEAR_HOME], move_time=0.05, rest_time=0.2)
    message = stand_in.run(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    assert message.motion == 'poses'
    position = np.array(message.position).reshape(-1, 4)
    reached = [NEAR_HOME.x, NEAR_HOME.y, NEAR_HOME.z, NEAR_HOME.phi]
    home = machine.forward(machine.home)
    assert position[0] == pytest.approx(home)
    assert position[message.move_ends[0]] == pytest.approx(reached)
    assert position[-1] == pytest.approx(home)
    assert message.move_ends[0] - message.move_starts[0] == round(0.05 / machine.sample_time)
    assert message.move_starts[1] - message.move_ends[0] == round(0.2 / machine.sample_time)


def test_trajectory_is_resent_until_the_machine_starts(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION)
    graph.spin_until(lambda: len(stand_in.trajectories) == 2, 'the trajectory a second time')
    assert [trajectory.cycle for trajectory in stand_in.trajectories] == [1, 1]
    stand_in.run(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


@pytest.mark.parametrize(
    ('goal', 'text'),
    [
        ({'motion': 'fly'}, "motions: 'fly' is unknown; "),
        ({'motion': 'planar_80ms'}, 'motion is for planar; the machine is four_dof'),
        ({'motion': MOTION, 'cycles': 0}, 'goal: cycles is 0; expected at least 1'),
        ({'motion': MOTION, 'learning_law': 'magic'}, "learning law 'magic' is unknown; known: ['none', 'basis'"),
        (
            {'motion': MOTION, 'controller': 'pid'},
            "goal: controller 'pid'; this cell has been started with 'robust'",
        ),
        ({'motion': MOTION, 'poses': [NEAR_HOME]}, "motion 'four_dof_70ms', 1 poses and experiment ''; give one"),
        ({'motion': MOTION, 'move_time': math.nan}, 'goal: move_time is nan s'),
        ({'motion': MOTION, 'move_time': 0.1}, 'goal: move_time is 0.1 s'),
        ({'motion': MOTION, 'rest_time': 0.1}, 'goal: rest_time is 0.1 s'),
        ({'poses': [NEAR_HOME], 'rest_time': 0.01}, 'rest time is 0.01 s; expected more than 0.02 s'),
        ({}, "goal: motion '', 0 poses and experiment ''; give one of them"),
        ({'poses': [NEAR_HOME, NAN]}, 'pose 1: z is nan; expected a finite number'),
        (
            {'poses': [BELOW_THE_TABLE]},
            'there z may go from 121.06 to 124.88 mm (z = -50 mm; allowed 10 to 126.6 mm (length of links 10 and 12))',
        ),
        (
            {'poses': [NEAR_HOME, BEYOND_TRAVEL]},
            'or phi may go from -57.65 to -33.50 deg (d1 = 59 mm; allowed 59.5 to 99.5 mm (travel))',
        ),
        ({'poses': [NEAR_HOME], 'move_time': 0.004}, 'm/s; allowed 0.8 m/s'),
        ({'poses': [NEAR_HOME], 'move_time': 0.0701}, 'move_time is 70.1 ms; expected a multiple of 0.5 ms'),
        ({'poses': [NEAR_HOME], 'move_time': -0.07}, 'move time is -0.07 s; expected a positive number'),
        ({'poses': [NEAR_HOME], 'move_time': math.nan}, 'move time is nan s; expected a positive number'),
        ({'poses': [NEAR_HOME], 'move_time': math.inf}, 'move time is inf s; expected a positive number'),
        (
            {'poses': [NEAR_HOME], 'move_time': 1e6},
            'move time is 1e+06 s; with their rests the 2 moves of a cycle take 2e+06 s; allowed up to 20 s',
        ),
        ({'poses': [NEAR_HOME] * 200}, 'the 201 moves of a cycle take 34.17 s; allowed up to 20 s'),
        ({'motion': MOTION, 'learned': '/tmp/nowhere.npz'}, '/tmp/nowhere.npz: cannot be read'),
    ],
)
def test_impossible_goal_is_refused_and_the_next_one_runs(graph, goals, stand_in, goal, text):
    graph.start(TrajectoryGeneratorNode)
    status, result = goals.result(goals.send(**goal))
    assert status == GoalStatus.STATUS_ABORTED
    assert result.cycles_completed == 0
    assert text in result.message
    assert not stand_in.trajectories
    goal = goals.send(motion=MOTION)
    stand_in.run(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


@pytest.mark.parametrize(
    ('extra', 'text'),
    [
        ({'z': math.nan}, 'pose 0: z is nan m; planar has no z, expected 0'),
        ({'phi': 3.0}, 'phi is 3 rad; planar has no'),
    ],
)
def test_pose_with_a_coordinate_of_another_machine_is_refused(graph, goals, extra, text):
    graph.start(TrajectoryGeneratorNode, machine='planar')
    x, y = load_machine('planar').forward(load_machine('planar').home)
    status, result = goals.result(goals.send(poses=[PlatformPose(x=x, y=y, **extra)]))
    assert status == GoalStatus.STATUS_ABORTED
    assert text in result.message


def test_computed_torque_accepts_only_goals_without_learning(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode, control='computed_torque')
    status, result = goals.result(goals.send(motion=MOTION, learning_law='fourier'))
    assert status == GoalStatus.STATUS_ABORTED
    assert 'd1 has TorqueGains; only controllers of single axes learn' in result.message
    goal = goals.send(motion=MOTION, controller='computed_torque')
    stand_in.run(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown"),
        (
            {'control': 'soft'},
            r"control: 'soft' given; allowed: \['robust', 'computed_torque', 'observer'\], .*'four_dof_thesis'",
        ),
        ({'start_timeout': math.nan}, r'/pkm/trajectory_generator: start_timeout is nan; expected a positive, finite'),
        ({'metrics_timeout': -1.0}, r'/pkm/trajectory_generator: metrics_timeout is -1.0; expected a positive, finite'),
        ({'timeout': 1.0}, r"trajectory_generator has unknown parameter\(s\) \['timeout'\]; known: .*'start_timeout'"),
    ],
)
def test_invalid_parameter_is_refused_by_name(graph, parameters, text):
    with pytest.raises(ConfigError, match=text):
        graph.start(TrajectoryGeneratorNode, **parameters)
