"""Node trajectory_generator: goals of execute_motion; the test stands in the place of the client and of the machine."""

import math
import re
import time

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from std_msgs.msg import UInt32

from pkm_core.config import find_config
from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError
from pkm_core.learning import make_law
from pkm_core.learning.store import Learned, origin_of, read, save
from pkm_core.machines import load_machine
from pkm_core.motions import load_motion, plan
from pkm_core.trajectory import DERIVATIVES, to_joints
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleEvent, CycleMetrics, PlatformPose, SampledTrajectory
from pkm_nodes.conversions import trajectory_from_msg
from pkm_nodes.node import LAST_VALUE_QOS, PkmNode
from pkm_nodes.trajectory_generator import TrajectoryGeneratorNode

JOINTS = ('d1', 'd3', 'd5', 'd7')
MOTION = 'four_dof_70ms'


class Client:
    """Sends goals and takes their results."""

    def __init__(self, graph):
        self._graph = graph
        self._client = ActionClient(graph.node, ExecuteMotion, 'execute_motion')
        self.feedback = []

    def send(self, **goal):
        """Return the handle of a goal that has been taken."""
        self._graph.spin_until(self._client.server_is_ready, 'the action server')
        sent = self._client.send_goal_async(
            ExecuteMotion.Goal(**{'cycles': 1} | goal), lambda message: self.feedback.append(message.feedback)
        )
        self._graph.spin_until(sent.done, 'the acceptance of the goal')
        return sent.result()

    def result(self, handle):
        """Return (status, result) of a goal when it has ended."""
        future = handle.get_result_async()
        self._graph.spin_until(future.done, 'the result of the goal')
        return future.result().status, future.result().result

    def close(self):
        self._client.destroy()


class Machine:
    """The test in the place of everything behind pose_trajectory."""

    def __init__(self, graph):
        self._graph = graph
        self.trajectories = graph.listen(SampledTrajectory, 'pose_trajectory')
        self._events = graph.publisher(CycleEvent, 'cycle_events')
        self._metrics = {joint: graph.publisher(CycleMetrics, f'{joint}/cycle_metrics') for joint in JOINTS}

    def tell(self, event, cycle, **fields):
        self._events.publish(CycleEvent(event=event, cycle=cycle, source='machine', **fields))

    def start(self, cycle):
        """Wait for the trajectory of `cycle`, start it and return the trajectory."""
        self._graph.spin_until(lambda: cycle in [t.cycle for t in self.trajectories], f'trajectory {cycle}')
        self.tell(CycleEvent.STARTED, cycle)
        return next(t for t in self.trajectories if t.cycle == cycle)

    def finish(self, cycle, errors=(1e-6, 2e-6, 3e-6, 4e-6)):
        for joint, error in zip(JOINTS, errors, strict=False):
            self._metrics[joint].publish(CycleMetrics(cycle=cycle, joint=joint, max_dynamic_error=error))
        self.tell(CycleEvent.FINISHED, cycle)

    def run(self, cycle):
        trajectory = self.start(cycle)
        self.finish(cycle)
        return trajectory


class SilentMachine(PkmNode):
    """All that a machine in the midst of a tick shows of itself."""

    def __init__(self, **kwargs):
        super().__init__('machine', **kwargs)
        self.create_publisher(UInt32, 'machine/cycle', LAST_VALUE_QOS)


@pytest.fixture
def client(graph):
    client = Client(graph)
    yield client
    client.close()


@pytest.fixture
def cell(graph):
    return Machine(graph)


def pose_at(joint_positions):
    x, y, z, phi = load_machine('four_dof').forward(joint_positions)
    return PlatformPose(x=x, y=y, z=z, phi=phi)


NEAR_HOME = pose_at([0.0815, 0.1415, 0.1375, 0.0815])
BEYOND_TRAVEL = pose_at([0.0590, 0.1395, 0.1395, 0.0795])  # d1 begins at 59.5 mm
BELOW_THE_TABLE = PlatformPose(x=NEAR_HOME.x, y=NEAR_HOME.y, z=-0.05, phi=NEAR_HOME.phi)
NAN = PlatformPose(x=NEAR_HOME.x, y=NEAR_HOME.y, z=math.nan, phi=NEAR_HOME.phi)


def test_motion_of_the_configuration_runs_its_cycles(graph, client, cell, machine):
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION, cycles=3, learning_law='fourier')
    sent = [cell.run(cycle) for cycle in (1, 2, 3)]
    status, result = client.result(goal)
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


def test_every_cycle_gives_feedback_with_the_error_of_every_joint(graph, client, cell):
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION, cycles=2)
    for cycle in (1, 2):
        cell.run(cycle)
    client.result(goal)
    graph.spin_until(lambda: len(client.feedback) == 2, 'the feedback of two cycles')
    assert [feedback.cycle for feedback in client.feedback] == [1, 2]
    assert client.feedback[0].joints == list(JOINTS)
    assert list(client.feedback[0].max_dynamic_error) == [1e-6, 2e-6, 3e-6, 4e-6]


def test_joint_without_metrics_has_a_nan_in_the_feedback_and_the_motion_goes_on(graph, client, cell):
    graph.start(TrajectoryGeneratorNode, metrics_timeout=0.1)
    goal = client.send(motion=MOTION)
    cell.start(1)
    cell.finish(1, errors=(1e-6, 2e-6, 3e-6))
    status, _ = client.result(goal)
    assert status == GoalStatus.STATUS_SUCCEEDED
    graph.spin_until(lambda: client.feedback, 'feedback')
    assert list(client.feedback[0].max_dynamic_error)[:3] == [1e-6, 2e-6, 3e-6]
    assert math.isnan(client.feedback[0].max_dynamic_error[3])


def test_poses_are_visited_from_home_and_back(graph, client, cell, machine):
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(poses=[NEAR_HOME], move_time=0.05)
    message = cell.run(1)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    assert message.motion == 'poses'
    position = np.array(message.position).reshape(-1, 4)
    reached = [NEAR_HOME.x, NEAR_HOME.y, NEAR_HOME.z, NEAR_HOME.phi]
    home = machine.forward(machine.home)
    assert position[0] == pytest.approx(home)
    assert position[message.move_ends[0]] == pytest.approx(reached)
    assert position[-1] == pytest.approx(home)
    assert message.move_ends[0] - message.move_starts[0] == round(0.05 / machine.sample_time)


def test_trajectory_is_sent_again_until_the_machine_starts(graph, client, cell):
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION)
    graph.spin_until(lambda: len(cell.trajectories) == 2, 'the trajectory a second time')
    assert [trajectory.cycle for trajectory in cell.trajectories] == [1, 1]
    cell.run(1)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


@pytest.mark.parametrize(
    ('goal', 'text'),
    [
        ({'motion': 'fly'}, "motions: 'fly' is unknown; "),
        ({'motion': 'planar_80ms'}, 'motion is for planar; the machine is four_dof'),
        ({'motion': MOTION, 'cycles': 0}, 'goal: cycles is 0; expected at least 1'),
        ({'motion': MOTION, 'learning_law': 'magic'}, "learning law 'magic' is unknown; known: ['none', 'basis'"),
        ({'motion': MOTION, 'controller': 'pid'}, "goal: controller 'pid'; this cell has been started with 'robust'"),
        ({'motion': MOTION, 'poses': [NEAR_HOME]}, "motion 'four_dof_70ms', 1 poses and experiment ''; give one"),
        ({'motion': MOTION, 'move_time': math.nan}, 'goal: move_time is nan s'),
        ({'motion': MOTION, 'move_time': 0.1}, 'goal: move_time is 0.1 s'),
        ({}, "goal: motion '', 0 poses and experiment ''; give one of them"),
        ({'poses': [NEAR_HOME, NAN]}, 'pose 1: z is nan; expected a finite number'),
        ({'poses': [BELOW_THE_TABLE]}, 'target 0: z = -50 mm; allowed 10 to 126.6 mm (length of links 10 and 12)'),
        ({'poses': [NEAR_HOME, BEYOND_TRAVEL]}, 'target 1: d1 = 59 mm; allowed 59.5 to 99.5 mm (travel)'),
        ({'poses': [NEAR_HOME], 'move_time': 0.004}, 'm/s; allowed 0.8 m/s'),
        ({'poses': [NEAR_HOME], 'move_time': 0.0701}, 'move_time is 70.1 ms; expected a multiple of 0.5 ms'),
        ({'poses': [NEAR_HOME], 'move_time': -0.07}, 'move time is -0.07 s; expected a positive number'),
        ({'poses': [NEAR_HOME], 'move_time': math.nan}, 'move time is nan s; expected a positive number'),
        ({'poses': [NEAR_HOME], 'move_time': math.inf}, 'move time is inf s; expected a positive number'),
        (
            {'poses': [NEAR_HOME], 'move_time': 1e6},
            'move time is 1e+06 s; with their rests the 2 moves of a cycle take 2e+06 s, allowed 20 s',
        ),
        ({'poses': [NEAR_HOME] * 200}, 'the 201 moves of a cycle take 34.17 s, allowed 20 s'),
        ({'motion': MOTION, 'learned': '/tmp/nowhere.npz'}, '/tmp/nowhere.npz: cannot be read'),
    ],
)
def test_goal_that_cannot_be_run_is_refused_and_the_next_one_runs(graph, client, cell, goal, text):
    graph.start(TrajectoryGeneratorNode)
    status, result = client.result(client.send(**goal))
    assert status == GoalStatus.STATUS_ABORTED
    assert result.cycles_completed == 0
    assert text in result.message
    assert not cell.trajectories
    goal = client.send(motion=MOTION)
    cell.run(1)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


@pytest.fixture
def learned(machine, tmp_path):
    """Return the path of a feedforward learned on MOTION, and that feedforward (N, n)."""
    trajectory = to_joints(machine, plan(machine, load_motion(MOTION)))
    feedforward = np.random.default_rng(2).normal(size=trajectory.position.shape)
    origin = origin_of(machine, MOTION, 'inverse', load_control(machine), trajectory)
    save(tmp_path / 'learned.npz', Learned(origin, feedforward, {}))
    return tmp_path / 'learned.npz', feedforward


@pytest.mark.parametrize('law', ['none', 'fourier'])
def test_learned_feedforward_comes_with_the_trajectory_of_the_first_cycle(graph, client, cell, learned, law):
    path, feedforward = learned
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION, cycles=2, learning_law=law, learned=str(path))
    first, second = (cell.run(cycle) for cycle in (1, 2))
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    assert np.array_equal(first.feedforward, feedforward.ravel())
    assert len(second.feedforward) == 0


def test_learned_feedforward_of_another_motion_is_refused(graph, client, cell, learned):
    path, _ = learned
    graph.start(TrajectoryGeneratorNode)
    status, result = client.result(client.send(poses=[NEAR_HOME], learned=str(path)))
    assert status == GoalStatus.STATUS_ABORTED
    assert f"{path}: was learned for another motion '{MOTION}', here 'poses'; reference" in result.message
    assert not cell.trajectories


def test_learned_feedforward_of_other_gains_is_refused(graph, client, cell, learned):
    path, _ = learned
    graph.start(TrajectoryGeneratorNode, control='four_dof_thesis')
    status, result = client.result(client.send(motion=MOTION, learned=str(path)))
    assert status == GoalStatus.STATUS_ABORTED
    assert f'{path}: was learned for another config' in result.message
    assert not cell.trajectories


def test_feedforward_of_the_wrong_length_is_refused(graph, client, learned):
    path, feedforward = learned
    save(path, Learned(read(path).origin, feedforward[:-1], {}))
    graph.start(TrajectoryGeneratorNode)
    status, result = client.result(client.send(motion=MOTION, learned=str(path)))
    assert status == GoalStatus.STATUS_ABORTED
    assert 'feedforward has shape (679, 4); expected (680, 4)' in result.message


def test_basis_parameters_give_the_first_feedforward_of_another_motion(graph, client, cell, machine, learned):
    path, feedforward = learned
    graph.start(TrajectoryGeneratorNode)
    control, trajectory = load_control(machine), to_joints(machine, plan(machine, load_motion(MOTION)))
    law = make_law('basis', machine, control)
    bound = law.with_reference(trajectory)
    parameters = {joint: bound.parameters(joint, column) for joint, column in zip(JOINTS, feedforward.T, strict=True)}
    save(path, Learned(origin_of(machine, MOTION, 'basis', control, trajectory), feedforward, parameters))
    goal = client.send(poses=[NEAR_HOME], learning_law='basis', learned=str(path))
    message = cell.run(1)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    poses = trajectory_from_msg(message, coordinates=machine.coordinates, sample_time=machine.sample_time)
    there = law.with_reference(to_joints(machine, poses))
    expected = [there.feedforward(joint, parameters[joint], rested=True) for joint in JOINTS]
    assert np.array_equal(np.reshape(message.feedforward, (-1, 4)), np.stack(expected, axis=1))


def test_law_that_would_diverge_is_refused_before_anything_moves(graph, client, cell, tmp_path):
    text = find_config('learning', 'inverse').read_text()
    (tmp_path / 'wide.yaml').write_text(text.replace('fall_to: 208 Hz', 'fall_to: 300 Hz').replace('160 Hz', '260 Hz'))
    graph.start(TrajectoryGeneratorNode)
    status, result = client.result(client.send(motion=MOTION, learning_law=str(tmp_path / 'wide.yaml')))
    assert status == GoalStatus.STATUS_ABORTED
    assert re.search(r"wide.yaml' would diverge: the error of d\d at .* Hz becomes \d\.\d+ times", result.message)
    assert not cell.trajectories


def test_cell_with_computed_torque_takes_goals_that_learn_nothing_and_refuses_others(graph, client, cell):
    graph.start(TrajectoryGeneratorNode, control='computed_torque')
    status, result = client.result(client.send(motion=MOTION, learning_law='fourier'))
    assert status == GoalStatus.STATUS_ABORTED
    assert 'd1 has TorqueGains; only robust control learns' in result.message
    goal = client.send(motion=MOTION, controller='computed_torque')
    cell.run(1)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_second_goal_is_refused_and_the_first_one_goes_on(graph, client, cell):
    graph.start(TrajectoryGeneratorNode)
    first = client.send(motion=MOTION, cycles=2)
    cell.start(1)
    status, result = client.result(client.send(motion=MOTION))
    assert status == GoalStatus.STATUS_ABORTED
    assert f"goal '{MOTION}': motion '{MOTION}', cycle 1 of 2 is running" in result.message
    cell.finish(1)
    cell.run(2)
    status, result = client.result(first)
    assert (status, result.cycles_completed) == (GoalStatus.STATUS_SUCCEEDED, 2)


def test_cancelled_goal_ends_after_the_cycle_that_runs(graph, client, cell):
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION, cycles=3)
    cell.start(1)
    cancelled = goal.cancel_goal_async()
    graph.spin_until(cancelled.done, 'the answer to the cancellation')
    cell.finish(1)
    status, result = client.result(goal)
    assert (status, result.cycles_completed) == (GoalStatus.STATUS_CANCELED, 1)
    assert result.message == 'cancelled after cycle 1 of 3; the machine stands at home'
    assert {trajectory.cycle for trajectory in cell.trajectories} == {1}


@pytest.mark.parametrize('event', [CycleEvent.REFUSED, CycleEvent.FAULT])
def test_cycle_that_is_refused_or_stopped_ends_the_goal_with_the_reason(graph, client, cell, event):
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION, cycles=3)
    cell.run(1)
    cell.start(2)
    cell.tell(event, 2, message='the door is open')
    status, result = client.result(goal)
    assert (status, result.cycles_completed) == (GoalStatus.STATUS_ABORTED, 1)
    assert result.message == 'machine: the door is open'
    goal = client.send(motion=MOTION)
    cell.run(3)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_machine_that_is_gone_in_the_midst_of_a_cycle_ends_the_goal_also_if_another_has_come(graph, client, cell):
    machine = graph.start(SilentMachine)
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION, cycles=3)
    cell.run(1)
    cell.start(2)
    graph.next_event(CycleEvent.STARTED, cycle=2)
    graph.spin_in_silence()  # the generator has heard of it too
    graph.start(SilentMachine)  # before the graph knows of the end of the first one
    graph.stop(machine)
    stop = graph.next_event(CycleEvent.STOP, cycle=2)
    assert stop.source == 'trajectory_generator'
    status, result = client.result(goal)
    assert (status, result.cycles_completed) == (GoalStatus.STATUS_ABORTED, 1)
    assert result.message == f'cycle 2: {stop.message}'
    assert 'the machine that ran it is gone' in stop.message
    goal = client.send(motion=MOTION)
    cell.run(3)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_machine_that_is_slow_is_waited_for(graph, client, cell):
    graph.start(SilentMachine)
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION)
    cell.start(1)
    looked_until = time.monotonic() + 2.5
    graph.spin_until(lambda: time.monotonic() > looked_until, 'two looks of the generator at the graph')
    cell.finish(1)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_events_of_another_cycle_do_not_end_the_goal(graph, client, cell):
    graph.start(TrajectoryGeneratorNode)
    goal = client.send(motion=MOTION)
    cell.start(1)
    cell.tell(CycleEvent.FAULT, 7, message='somebody else')
    cell.finish(1)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_cycle_that_does_not_start_ends_the_goal_and_says_who_listens(graph, client, cell):
    graph.start(TrajectoryGeneratorNode, start_timeout=0.1)
    status, result = client.result(client.send(motion=MOTION))
    assert status == GoalStatus.STATUS_ABORTED
    assert result.message.startswith('cycle 1 did not start within 0.1 s; 1 node(s) listen to /pkm/pose_trajectory')


def test_generator_that_comes_up_late_goes_on_after_the_last_cycle_of_the_machine(graph, client, cell):
    graph.publisher(UInt32, 'machine/cycle', LAST_VALUE_QOS).publish(UInt32(data=41))
    graph.start(TrajectoryGeneratorNode)
    graph.spin_in_silence()
    goal = client.send(motion=MOTION)
    cell.run(42)
    assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown"),
        ({'control': 'soft'}, r"control 'soft' is none of \['robust', 'computed_torque'\]; .*'four_dof_thesis'"),
        ({'start_timeout': math.nan}, r'/pkm/trajectory_generator: start_timeout is nan; expected a positive, finite'),
        ({'metrics_timeout': -1.0}, r'/pkm/trajectory_generator: metrics_timeout is -1.0; expected a positive, finite'),
        ({'timeout': 1.0}, r"trajectory_generator has unknown parameter\(s\) \['timeout'\]; known: .*'start_timeout'"),
    ],
)
def test_parameter_that_cannot_be_is_refused_by_name(graph, parameters, text):
    with pytest.raises(ConfigError, match=text):
        graph.start(TrajectoryGeneratorNode, **parameters)
