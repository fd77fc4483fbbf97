"""Node trajectory_generator: the action follow_joint_trajectory, which exists where control_msgs is installed."""

import importlib.util
from math import nan
from pathlib import Path

import pytest
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration, Time
from rclpy.action import ActionClient, get_action_names_and_types
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory

from pkm_interfaces.msg import CycleError, CycleEvent, Standing
from pkm_nodes.messages.conversions import time_of_tick
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.runtime.node import CYCLE_QOS, LAST_VALUE_QOS
from support.goals import JOINTS, MOTION

NAME = 'follow_joint_trajectory'
MM, UM = 1e-3, 1e-6
LEAD, FIRST_TICK = 40, 1000  # samples of rest before the trajectory; tick at which the cycle starts
EXISTS = importlib.util.find_spec('control_msgs') is not None
needs_package = pytest.mark.skipif(not EXISTS, reason='control_msgs is not among the wheels; see docs/commands.md')


def trajectory(*points, names=JOINTS, stamp=0):
    """Return a JointTrajectory of points (time [s], positions [m])."""
    points = [
        JointTrajectoryPoint(
            positions=[float(each) for each in positions], time_from_start=Duration(nanosec=round(1e9 * time))
        )
        for time, positions in points
    ]
    command = JointTrajectory(joint_names=list(names), points=points)
    command.header.stamp = Time(sec=stamp)
    return command


class Follower:
    """A client of the action, and the topics of the cell that the generator reads in its cycles."""

    def __init__(self, graph, stand_in):
        from control_msgs.action import FollowJointTrajectory
        from control_msgs.msg import JointComponentTolerance, JointTolerance

        self.action, self.tolerance, self.component = FollowJointTrajectory, JointTolerance, JointComponentTolerance
        self._graph, self._stand_in, self.feedback = graph, stand_in, []
        self._errors = {joint: graph.publisher(CycleError, f'{joint}/cycle_error', CYCLE_QOS) for joint in JOINTS}
        self._states = graph.publisher(JointState, 'joint_states', CYCLE_QOS)
        graph.start(TrajectoryGeneratorNode)
        self._client = ActionClient(graph.node, FollowJointTrajectory, NAME)
        graph.spin_until(self._client.server_is_ready, 'the action server')

    def send(self, command, **fields):
        """Return the handle of a goal; tolerances are {joint: position [m]} or messages."""
        for name in ('path_tolerance', 'goal_tolerance'):
            given = fields.get(name, {})
            if isinstance(given, dict):
                fields[name] = [self.tolerance(name=joint, position=value) for joint, value in given.items()]
        goal = self.action.Goal(trajectory=command, **fields)
        sent = self._client.send_goal_async(goal, lambda message: self.feedback.append(message.feedback))
        self._graph.spin_until(sent.done, 'the acceptance of the goal')
        return sent.result()

    def end(self, handle):
        """Return (status, name of the error code, text) of a goal when it has ended."""
        future = handle.get_result_async()
        self._graph.spin_until(future.done, 'the result of the goal')
        result = future.result().result
        codes = ('SUCCESSFUL', 'INVALID_GOAL', 'INVALID_JOINTS', 'OLD_HEADER_TIMESTAMP')
        codes += 'PATH_TOLERANCE_VIOLATED', 'GOAL_TOLERANCE_VIOLATED'
        names = {getattr(self.action.Result, name): name for name in codes}
        return future.result().status, names[result.error_code], result.error_string

    def refusal(self, command, **fields):
        """Return (code, text) of a goal that is aborted."""
        status, *rest = self.end(self.send(command, **fields))
        assert status == GoalStatus.STATUS_ABORTED
        return tuple(rest)

    def start(self, cycle):
        message = self._stand_in.start(cycle)
        self._stand_in.tell(CycleEvent.STARTED, cycle, tick=FIRST_TICK)
        return message

    def state(self, sample, positions):
        """Publish the state of a sample of the cycle until there is feedback of it."""
        stamp = time_of_tick(FIRST_TICK + sample, 5e-4)
        message = JointState(name=list(JOINTS), position=[float(each) for each in positions])
        message.header.stamp = stamp

        def has_feedback():  # the generator subscribes with its first goal
            self._states.publish(message)
            return self.feedback

        self._graph.spin_until(has_feedback, 'the feedback')

    def finish(self, cycle, samples, errors):
        """Finish a cycle of `samples` with a constant error [m] per joint."""
        for joint, error in zip(JOINTS, errors, strict=True):
            self._errors[joint].publish(CycleError(cycle=cycle, joint=joint, error=samples * [error]))
        self._stand_in.finish(cycle)

    def run(self, cycle, errors=4 * (UM,)):
        message = self.start(cycle)
        self.finish(cycle, len(message.position) // len(message.coordinates), errors)
        return message

    def close(self):
        self._client.destroy()


@pytest.fixture
def follower(graph, stand_in):
    follower = Follower(graph, stand_in)
    yield follower
    follower.close()


@pytest.mark.skipif(EXISTS, reason='control_msgs is installed')
def test_without_control_msgs_the_node_offers_no_such_action(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION)
    stand_in.run(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    assert f'/pkm/{NAME}' not in dict(get_action_names_and_types(graph.node))
    page = (Path(__file__).resolve().parents[2] / 'docs' / 'commands.md').read_text(encoding='utf-8')
    assert 'Without it the cell runs and does not offer the action.' in page


@needs_package
def test_goal_within_tolerances_succeeds_and_stays(follower, machine):
    fields = {'path_tolerance': {'d1': 5 * UM}, 'goal_tolerance': dict.fromkeys(JOINTS, 2 * UM)}
    goal = follower.send(trajectory((0.1, machine.home + MM)), goal_time_tolerance=Duration(sec=1), **fields)
    message = follower.run(1)
    assert (message.motion, message.stay) == (NAME, True)
    assert follower.end(goal) == (GoalStatus.STATUS_SUCCEEDED, 'SUCCESSFUL', '')
    goal = follower.send(trajectory((0.0, machine.home + MM), (0.1, machine.home)))  # without tolerances
    follower.run(2, (nan, 1.0, 1.0, 1.0))
    assert follower.end(goal)[1] == 'SUCCESSFUL'


@needs_package
def test_goal_outside_a_tolerance_is_aborted_with_its_code(follower, machine):
    there, home = trajectory((0.1, machine.home + MM)), trajectory((0.1, machine.home))
    for cycle, command, kind, text in (
        (1, there, 'path', 'path_tolerance: error of d3 is -9 um at 0.0000 s; allowed: 5 um'),
        (2, home, 'goal', 'goal_tolerance: error of d3 is -9 um 0.08 s after the end; allowed: 5 um'),
    ):
        goal = follower.send(command, **{f'{kind}_tolerance': {'d3': 5 * UM}})
        follower.run(cycle, (UM, -9 * UM, UM, UM))
        assert follower.end(goal) == (GoalStatus.STATUS_ABORTED, f'{kind.upper()}_TOLERANCE_VIOLATED', text)


@needs_package
def test_feedback_carries_reference_measurement_and_error(follower, machine):
    goal = follower.send(trajectory((0.1, machine.home + MM)))
    message = follower.start(1)
    actual = machine.home + 0.5 * MM - 2 * UM
    follower.state(LEAD + 100, actual)
    feedback = follower.feedback[0]
    assert tuple(feedback.joint_names) == JOINTS
    assert feedback.header.stamp == time_of_tick(FIRST_TICK + LEAD + 100, 5e-4)
    assert feedback.error.time_from_start == Duration(nanosec=50_000_000)
    assert list(feedback.desired.positions) == pytest.approx(machine.home + 0.5 * MM, abs=1e-9)
    assert list(feedback.actual.positions) == pytest.approx(actual)
    assert list(feedback.error.positions) == pytest.approx(4 * [2 * UM], abs=1e-9)
    follower.finish(1, len(message.position) // 4, 4 * (UM,))
    assert follower.end(goal)[1] == 'SUCCESSFUL'


@needs_package
def test_state_outside_the_path_tolerance_stops_the_machine(graph, follower, stand_in, machine):
    goal = follower.send(trajectory((0.1, machine.home + MM)), path_tolerance={'d3': 5 * UM})
    follower.start(1)
    follower.state(LEAD + 100, machine.home + 0.5 * MM - [0.0, 7 * UM, 0.0, 0.0])
    text = 'path_tolerance: error of d3 is 7 um at 0.0500 s; allowed: 5 um'
    assert graph.next_event(CycleEvent.STOP, cycle=1).message == f'{NAME}: {text}'
    stand_in.tell(CycleEvent.FAULT, 1, message='stopped')
    assert follower.end(goal) == (GoalStatus.STATUS_ABORTED, 'PATH_TOLERANCE_VIOLATED', text)


@needs_package
def test_cancel_stops_the_machine_at_once_or_at_the_start(graph, follower, stand_in, machine):
    for cycle, is_early in ((1, False), (2, True)):
        goal = follower.send(trajectory((0.1, machine.home + MM)))
        if not is_early:
            follower.start(cycle)
            follower.state(LEAD, machine.home)
        else:
            graph.spin_until(lambda: 2 in [t.cycle for t in stand_in.trajectories], 'trajectory 2')
        cancelled = goal.cancel_goal_async()
        graph.spin_until(cancelled.done, 'the answer to the cancel request')
        assert len(cancelled.result().goals_canceling) == 1
        if is_early:
            stand_in.tell(CycleEvent.STARTED, cycle, tick=FIRST_TICK)
        assert graph.next_event(CycleEvent.STOP, cycle=cycle).message == f'{NAME} was cancelled'
        stand_in.tell(CycleEvent.FAULT, cycle, message='stopped')
        assert follower.end(goal) == (GoalStatus.STATUS_CANCELED, 'SUCCESSFUL', 'cancelled: machine: stopped')


@needs_package
def test_bad_goals_are_refused_with_code_and_reason(graph, follower, stand_in, machine):
    standing = graph.publisher(Standing, 'machine/standing', LAST_VALUE_QOS)
    at_10_s = {'tick': 20_000, 'joints': list(JOINTS), 'position': machine.home.tolist()}
    standing.publish(Standing(**at_10_s))
    graph.spin_in_silence()
    home = machine.home
    good = trajectory((0.1, home + MM))
    multi = MultiDOFJointTrajectory(joint_names=['platform'])
    fast = [follower.tolerance(name='d1', velocity=0.1)]
    for command, fields, code, text in (
        (trajectory((0.1, home), names=('d1', 'd2', 'd3', 'd4')), {}, 'INVALID_JOINTS', 'expected each of'),
        (trajectory((0.1, home[:3]), names=JOINTS[:3]), {}, 'INVALID_JOINTS', "['d1', 'd3', 'd5']; expected each of"),
        (trajectory(), {}, 'INVALID_GOAL', '0 points; expected at least 1'),
        (trajectory((0.2, home + MM), (0.1, home)), {}, 'INVALID_GOAL', 'expected increasing times'),
        (trajectory((0.1, [nan, *home[1:]])), {}, 'INVALID_GOAL', 'positions of d1 is nan'),
        (trajectory((0.1, home + 0.03)), {}, 'INVALID_GOAL', 'out of reach'),
        (trajectory((0.01, home + 10 * MM)), {}, 'INVALID_GOAL', 'moves at 1.000 m/s; allowed 0.8 m/s'),
        (trajectory((0.1, home), stamp=9), {}, 'OLD_HEADER_TIMESTAMP', 'the trajectory ends at 9.1000 s'),
        (trajectory((0.1, home), stamp=12), {}, 'INVALID_GOAL', 'header.stamp is 12.0000 s; allowed: 0, or'),
        (good, {'multi_dof_trajectory': multi}, 'INVALID_GOAL', 'multi_dof_trajectory: 1 entries; expected none'),
        (good, {'component_path_tolerance': [follower.component()]}, 'INVALID_GOAL', 'component_path_tolerance: 1'),
        (good, {'component_goal_tolerance': [follower.component()]}, 'INVALID_GOAL', 'component_goal_tolerance: 1'),
        (good, {'path_tolerance': {'d9': UM}}, 'INVALID_JOINTS', "path_tolerance: joints ['d9']; allowed"),
        (good, {'path_tolerance': {'d1': -2.0}}, 'INVALID_GOAL', 'position of d1 is -2; allowed: 0 or more, or -1'),
        (good, {'goal_tolerance': {'d1': nan}}, 'INVALID_GOAL', 'goal_tolerance: position of d1 is nan'),
        (good, {'goal_tolerance': fast}, 'INVALID_GOAL', 'velocity of d1 is 0.1; expected 0 or -1'),
        (good, {'goal_time_tolerance': Duration(sec=-2)}, 'INVALID_GOAL', 'goal_time_tolerance is -2; allowed'),
    ):
        found = follower.refusal(command, **fields)
        assert (found[0], text in found[1]) == (code, True), found
    assert not stand_in.trajectories
    goal = follower.send(trajectory((0.1, home), stamp=10), path_tolerance={'d1': -1.0})
    follower.run(1, 4 * (1.0,))
    assert follower.end(goal)[1] == 'SUCCESSFUL'


@needs_package
def test_goals_and_other_commands_exclude_each_other(graph, follower, goals, stand_in, machine):
    command = trajectory((0.1, machine.home + MM))
    goal = follower.send(command)
    message = follower.start(1)
    running = f'{NAME} is running; wait for its end or cancel it'
    assert follower.refusal(command) == ('INVALID_GOAL', f"goal '{NAME}': {running}")
    assert goals.result(goals.send(motion=MOTION))[1].message == f"goal '{MOTION}': {running}"
    follower.finish(1, len(message.position) // 4, 4 * (UM,))
    assert follower.end(goal)[1] == 'SUCCESSFUL'
    commands = graph.publisher(JointTrajectory, 'joint_trajectory_command', CYCLE_QOS)
    commands.publish(trajectory((0.1, machine.home)))
    stand_in.start(2)
    code, text = follower.refusal(command)
    assert (code, 'joint_trajectory_command of /pkm/test is running' in text) == ('INVALID_GOAL', True)
    stand_in.finish(2)


@needs_package
def test_unmeasured_tolerances_are_refused_or_not_met(graph, follower, stand_in, machine):
    """A controller of the user's own need not publish cycle_error; without tolerances its goal runs."""
    goal = follower.send(trajectory((0.1, machine.home + MM)), goal_tolerance={'d3': UM})
    follower.start(1)
    stand_in.finish(1)  # without errors
    assert follower.end(goal)[1:] == (
        'GOAL_TOLERANCE_VIOLATED',
        "tolerances: not checked, no 401 errors of ['d3'] within 2 s (cycle_error)",
    )
    graph.node.destroy_publisher(follower._errors['d3'])
    name = graph.node.resolve_topic_name('d3/cycle_error')
    graph.spin_until(lambda: not graph.node.count_publishers(name), 'the end of the publisher')
    code, text = follower.refusal(trajectory((0.1, machine.home)), goal_tolerance={'d3': UM})
    assert (code, 'no publisher of d3/cycle_error' in text) == ('INVALID_GOAL', True)
