"""Goals that stay, go_to and home: through the generator, and agreed by the machine, generator and controllers."""

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from pkm_core.motion.trajectory import to_joints
from pkm_interfaces.action import GoTo, Home
from pkm_interfaces.msg import CycleEvent, Excitation, PlatformPose, Standing
from pkm_nodes.messages.conversions import trajectory_from_msg
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.runtime.node import LAST_VALUE_QOS
from support.goals import JOINTS, MOTION, NEAR_HOME

SUCCEEDED, ABORTED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_ABORTED


@pytest.fixture
def ask(graph):
    """Return a function that sends a goal of an action and returns the future of its answer."""
    clients = []

    def ask(kind, name, **goal):
        client = ActionClient(graph.node, kind, name)
        clients.append(client)
        graph.spin_until(client.server_is_ready, f'the server of {name}')
        sent = client.send_goal_async(kind.Goal(**goal))
        graph.spin_until(sent.done, 'the acceptance of the goal')
        return sent.result().get_result_async()

    yield ask
    for client in clients:
        client.destroy()


@pytest.fixture
def answer(graph):
    def wait(future):
        graph.spin_until(future.done, 'the result')
        return future.result().status, future.result().result

    return wait


def joints_of(message, machine):
    times = {'sample_time': machine.sample_time}
    return to_joints(machine, trajectory_from_msg(message, coordinates=machine.coordinates, **times)).position


def test_next_goal_begins_where_a_motion_that_stays_has_ended(graph, goals, stand_in, machine):
    graph.start(TrajectoryGeneratorNode)
    first = goals.send(poses=[NEAR_HOME], stay=True)
    sent = stand_in.run(1)
    assert goals.result(first)[0] == SUCCEEDED
    assert sent.stay
    there = joints_of(sent, machine)[-1]
    assert there == pytest.approx([0.0815, 0.1415, 0.1375, 0.0815])
    status, result = goals.result(goals.send(motion=MOTION))
    assert status == ABORTED
    assert 'motion: begins and ends at home; the machine stands elsewhere, d' in result.message
    assert '2 mm; call the action home first, or give stay' in result.message
    second = goals.send(poses=[NEAR_HOME], stay=True)
    np.testing.assert_allclose(joints_of(stand_in.run(2), machine)[0], there, atol=1e-12)
    assert goals.result(second)[0] == SUCCEEDED


@pytest.mark.parametrize('extra', [{'cycles': 2}, {'learning_law': 'fourier'}, {'learned': 'some.npz'}])
def test_motion_that_stays_is_neither_repeated_nor_learned(graph, goals, stand_in, extra):
    graph.start(TrajectoryGeneratorNode)
    status, result = goals.result(goals.send(motion=MOTION, stay=True, **extra))
    assert status == ABORTED
    assert "of a motion that stays; expected 1, 'none' and ''" in result.message
    assert not stand_in.trajectories


def test_go_to_and_home_run_one_cycle_each(graph, ask, answer, stand_in, machine):
    graph.start(TrajectoryGeneratorNode)
    future = ask(GoTo, 'go_to', pose=PlatformPose(z=1e-3), coordinates=['z'], relative=True)
    stand_in.run(1)
    status, result = answer(future)
    assert (status, result.message, result.cycle) == (SUCCEEDED, '', 1)
    x, y, z, phi = machine.forward(machine.home)
    assert [result.pose.x, result.pose.y, result.pose.z, result.pose.phi] == pytest.approx([x, y, z + 1e-3, phi])
    future = ask(Home, 'home', move_time=0.1)
    back = stand_in.run(2)
    assert answer(future)[0] == SUCCEEDED
    np.testing.assert_allclose(joints_of(back, machine)[-1], machine.home, atol=1e-12)
    assert back.move_ends[0] - back.move_starts[0] == 200
    status, result = answer(ask(Home, 'home'))
    assert (status, result.message, result.cycle) == (SUCCEEDED, 'the machine stands at home', 0)


@pytest.mark.parametrize(
    ('goal', 'text'),
    [
        ({'pose': PlatformPose(z=0.2), 'coordinates': ['z']}, 'go_to: x 91.3728 mm, y 91.3728 mm, z 200 mm'),
        ({'pose': PlatformPose(z=0.2), 'coordinates': ['w']}, "go_to: coordinates ['w']; allowed"),
        ({'pose': PlatformPose(z=float('nan')), 'coordinates': ['z']}, 'go_to: z is nan; expected a finite number'),
        ({'pose': NEAR_HOME, 'move_time': -1.0}, 'move time is -1.0 s; expected a positive number'),
    ],
)
def test_go_to_is_refused_and_nothing_moves(graph, ask, answer, stand_in, goal, text):
    graph.start(TrajectoryGeneratorNode)
    status, result = answer(ask(GoTo, 'go_to', **goal))
    assert status == ABORTED
    assert text in result.message
    assert not stand_in.trajectories


def test_second_commander_is_refused_while_a_goal_runs(graph, goals, ask, answer, stand_in):
    graph.start(TrajectoryGeneratorNode)
    first = goals.send(motion=MOTION)
    stand_in.start(1)
    for kind, name in ((GoTo, 'go_to'), (Home, 'home')):
        status, result = answer(ask(kind, name))
        assert status == ABORTED
        assert f"goal '{name}': motion '{MOTION}', cycle 1 of 1 is running" in result.message
    stand_in.finish(1)
    assert goals.result(first)[0] == SUCCEEDED


def test_restarted_generator_begins_where_the_machine_stands(graph, ask, answer, stand_in, machine):
    """The machine keeps its last report for late subscribers."""
    reports = graph.publisher(Standing, 'machine/standing', LAST_VALUE_QOS)
    there = (machine.home + 1e-3).tolist()
    reports.publish(Standing(cycle=7, joints=list(JOINTS), position=there))
    generator = graph.start(TrajectoryGeneratorNode)
    graph.spin_until(lambda: not generator._cycles.standing.is_at_home, 'the report of the machine')
    future = ask(Home, 'home')
    graph.spin_until(lambda: stand_in.trajectories, 'a trajectory')
    message = stand_in.run(stand_in.trajectories[0].cycle)
    assert answer(future)[0] == SUCCEEDED
    np.testing.assert_allclose(joints_of(message, machine)[[0, -1]], [there, machine.home], atol=1e-12)


def test_identification_away_from_home_is_refused(graph, goals, stand_in, joint_trajectory, machine):
    reports = graph.publisher(Standing, 'machine/standing', LAST_VALUE_QOS)
    reports.publish(Standing(cycle=7, joints=list(JOINTS), position=(machine.home + 1e-3).tolist()))
    generator = graph.start(TrajectoryGeneratorNode)
    graph.spin_until(lambda: not generator._cycles.standing.is_at_home, 'the report of the machine')
    excitation = [Excitation(joint=joint) for joint in JOINTS]
    status, result = goals.result(goals.send(experiment=joint_trajectory(0), excitation=excitation))
    assert status == ABORTED
    assert "experiment 'short' begins at home; the machine stands elsewhere; call the action home" in result.message
    assert not stand_in.trajectories


def test_machine_reports_where_it_stands_to_late_subscribers(graph, machine):
    graph.start(MachineNode)
    reports = graph.listen(Standing, 'machine/standing', LAST_VALUE_QOS)
    graph.spin_until(lambda: reports, 'the report at power-up')
    assert tuple(reports[0].joints) == JOINTS
    assert reports[0].position == pytest.approx(machine.home, abs=machine.encoder_resolution)


def test_controller_refuses_a_cycle_that_begins_elsewhere(graph, axis, joint_trajectory, machine):
    """After the report of a machine that stands away from home, the next cycle begins there."""
    reports = graph.publisher(Standing, 'machine/standing', LAST_VALUE_QOS)
    graph.start(JointControllerNode, joint='d3')
    reports.publish(Standing(cycle=0, joints=list(JOINTS), position=(machine.home + 1e-3).tolist()))
    graph.spin_in_silence()
    axis.send(joint_trajectory(1))
    refusal = graph.next_event(CycleEvent.REFUSED, cycle=1)
    assert ' is -1 mm from where the machine stands at the first sample; allowed 20 um' in refusal.message
