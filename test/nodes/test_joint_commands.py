"""Node trajectory_generator: commands on joint_trajectory_command that run, and those that are refused."""

from math import nan

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pkm_core.motion.trajectory import to_joints
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.conversions import trajectory_from_msg
from pkm_nodes.messages.diagnostics import values_of
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.runtime.node import CYCLE_QOS
from support.goals import JOINTS, MOTION

MM = 1e-3
TOPIC = 'joint_trajectory_command'


def command(*points, names=JOINTS):
    """Return a message of points (time [s], positions [m])."""
    return JointTrajectory(
        joint_names=list(names),
        points=[
            JointTrajectoryPoint(
                positions=[float(value) for value in positions],
                time_from_start=Duration(nanosec=round(1e9 * time % 1e9), sec=int(time)),
            )
            for time, positions in points
        ],
    )


@pytest.fixture
def commands(graph):
    graph.start(TrajectoryGeneratorNode)
    return graph.publisher(JointTrajectory, TOPIC, CYCLE_QOS)


def test_command_runs_as_a_cycle_that_stays(graph, commands, stand_in, machine):
    there = machine.home + MM
    commands.publish(command((0.1, there)))
    message = stand_in.run(1)
    assert (message.motion, message.learning_law, message.stay) == (TOPIC, 'none', True)
    poses = trajectory_from_msg(message, coordinates=machine.coordinates, sample_time=machine.sample_time)
    joints = to_joints(machine, poses).position
    np.testing.assert_allclose(joints[[0, -1]], [machine.home, there], atol=1e-9)
    graph.spin_in_silence()
    commands.publish(command((0.0, there), (0.1, machine.home)))
    poses = trajectory_from_msg(stand_in.run(2), coordinates=machine.coordinates, sample_time=machine.sample_time)
    np.testing.assert_allclose(to_joints(machine, poses).position[0], there, atol=1e-9)


def refused(graph, commands, message):
    """Publish `message` and return the reason of the NOTICE event that refuses it."""
    commands.publish(message)
    return graph.next_event(CycleEvent.NOTICE, source='trajectory_generator').message


def test_bad_commands_are_refused_with_their_reason(graph, commands, stand_in, machine):
    home = machine.home
    for message, text in (
        (command(), '0 points; expected at least 1'),
        (
            command((0.1, home), names=('d1', 'd2', 'd3', 'd4')),
            "joint names ['d1', 'd2', 'd3', 'd4']; expected each of",
        ),
        (command((0.2, home + MM), (0.1, home)), 'expected increasing times'),
        (command((0.1, [nan, *home[1:]])), 'point 0: positions of d1 is nan; expected a finite number'),
        (
            command((0.1, [home[0] + 0.03, *home[1:]])),
            'point 0: by d1 30 mm, d3 0 mm, d5 0 mm, d7 0 mm is out of reach',
        ),
        (command((0.01, home + 10 * MM)), 'moves at 1.000 m/s; allowed 0.8 m/s (sample 40 is at 0 s, 0.5 ms each)'),
        (command((0.0, home + MM), (0.1, home)), 'begins 1 mm from where the machine stands'),
        (command((30.0, home + MM)), 'takes 30 s; allowed: more than 0, up to 20 s'),
    ):
        assert text in refused(graph, commands, message)
    assert not stand_in.trajectories
    commands.publish(command((0.1, home + MM)))
    stand_in.run(1)


def test_refusal_is_in_the_diagnostics_until_the_next_command(graph, commands, stand_in, machine):
    statuses = graph.listen(DiagnosticArray, '/diagnostics', 10)

    def last():
        return next((values_of(s.status[0]) for s in reversed(statuses) if 'refusal' in values_of(s.status[0])), {})

    refused(graph, commands, command())
    graph.spin_until(lambda: last().get('refusal'), 'the refusal in the diagnostics')
    assert last() == {
        'state': 'standing',
        'goal': '',
        'refused commands': '1',
        'refusal': 'joint trajectory: 0 points; expected at least 1',
    }
    commands.publish(command((0.1, machine.home + MM)))
    stand_in.start(1)
    graph.spin_until(lambda: last().get('state') == 'running', 'the running command in the diagnostics')
    assert (last()['goal'], last()['refusal']) == (f'{TOPIC} of /pkm/test', '')
    stand_in.finish(1)


def test_command_is_refused_while_a_goal_runs_and_vice_versa(graph, commands, goals, stand_in, machine):
    goal = goals.send(motion=MOTION)
    stand_in.start(1)
    reason = refused(graph, commands, command((0.1, machine.home + MM)))
    assert reason.startswith(f"{TOPIC}: goal '{TOPIC} of /pkm/test': motion '{MOTION}', cycle 1 of 1 is running; wait")
    stand_in.finish(1)
    goals.result(goal)
    commands.publish(command((0.1, machine.home + MM)))
    stand_in.start(2)
    _, result = goals.result(goals.send(motion=MOTION))
    assert f"goal '{MOTION}': {TOPIC} of /pkm/test is running" in result.message
    assert '/pkm/test is running' in refused(graph, commands, command((0.1, machine.home)))
    stand_in.finish(2)


def test_command_that_the_machine_refuses_lets_the_next_one_run(graph, commands, stand_in, machine):
    commands.publish(command((0.1, machine.home + MM)))
    stand_in.start(1)
    stand_in.tell(CycleEvent.FAULT, 1, message='the door is open')
    assert graph.next_event(CycleEvent.NOTICE).message == f'{TOPIC}: machine: the door is open'
    commands.publish(command((0.1, machine.home + MM)))
    stand_in.run(2)
