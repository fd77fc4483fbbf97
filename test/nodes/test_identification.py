"""Node identification: refusals and ends of a goal; the test replaces the excited cell."""

import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer
from rclpy.task import Future
from std_msgs.msg import UInt64

from pkm_interfaces.action import ExecuteMotion, Identify
from pkm_interfaces.msg import CycleEvent, MotorCommand
from pkm_nodes.nodes.identification import IdentificationNode

JOINTS = ('d1', 'd3')


class Cell:
    """Replacement of joint controllers, recorder and trajectory generator of a planar machine."""

    def __init__(self, graph, joints=JOINTS, *, records=True):
        self._graph = graph
        self.goals = []
        self.ended = Future()  # set to end the running cycle with a message
        for joint in joints:
            graph.node.create_publisher(MotorCommand, f'{joint}/command', 1000)
        if records:
            graph.node.create_publisher(UInt64, 'recorder/tick', 1000)
        self._events = graph.publisher(CycleEvent, 'cycle_events')
        self._server = ActionServer(graph.node, ExecuteMotion, 'execute_motion', self._execute)

    async def _execute(self, handle):
        self.goals.append(handle.request)
        result = ExecuteMotion.Result(message=await self.ended)
        handle.abort()
        return result

    def tell(self, event, cycle):
        self._events.publish(CycleEvent(event=event, source='machine', cycle=cycle))

    def wait_for_goal(self):
        self._graph.spin_until(lambda: self.goals, 'a goal of execute_motion')
        return self.goals[-1]

    def close(self):
        if self._server is not None:
            self._server.destroy()
            self._server = None


class Client:
    """Client that sends goals of identify and receives their results."""

    def __init__(self, graph):
        self._graph = graph
        self._client = ActionClient(graph.node, Identify, 'identify')
        self.feedback = []

    def send(self, **goal):
        self._graph.spin_until(self._client.server_is_ready, 'the action server')
        sent = self._client.send_goal_async(
            Identify.Goal(**goal), lambda message: self.feedback.append(message.feedback)
        )
        self._graph.spin_until(sent.done, 'the acceptance of the goal')
        return sent.result()

    def end(self, handle):
        future = handle.get_result_async()
        self._graph.spin_until(future.done, 'the result of the goal')
        return future.result().status, future.result().result.message

    def close(self):
        self._client.destroy()


@pytest.fixture
def client(graph, tmp_path):
    graph.start(IdentificationNode, machine='planar', folder=str(tmp_path))
    client = Client(graph)
    yield client
    client.close()


@pytest.fixture
def cell_of(graph):
    made = []

    def make(*arguments, **options):
        made.append(Cell(graph, *arguments, **options))
        return made[-1]

    yield make
    for cell in made:
        cell.close()


@pytest.mark.parametrize(
    ('goal', 'reason'),
    [
        ({'joints': ['d5']}, "joint 'd5' is unknown; planar has ['d1', 'd3']"),
        ({'kind': 3}, 'identify: kind is 3; allowed: 0 (BOTH), 1 (LOW_FREQUENCY), 2 (SWEEP)'),
        ({'band': [80.0, 1200.0]}, 'd1: sweep from 80 to 1200 Hz; expected 0 < from < to < 1000 Hz'),
        ({'jog_speed': 0.2}, 'leaves the travel'),
        ({'kind': Identify.Goal.SWEEP}, "kind 'sweep': no slow moves of ['d1', 'd3'] yet; send a goal of kind BOTH"),
    ],
)
def test_infeasible_goal_is_refused_before_any_motion(cell_of, client, goal, reason):
    cell = cell_of()
    status, message = client.end(client.send(**goal))
    assert status == GoalStatus.STATUS_ABORTED
    assert reason in message
    assert not cell.goals


def test_axis_without_a_controller_is_refused(cell_of, client):
    cell = cell_of(('d1',))
    status, message = client.end(client.send())
    assert status == GoalStatus.STATUS_ABORTED
    assert message == 'd3 is not enabled: no joint_controller publishes /pkm/d3/command'
    assert not cell.goals


def test_goal_without_a_recorder_is_refused(cell_of, client):
    cell_of(records=False)
    _, message = client.end(client.send())
    assert message == 'raw records are kept as bags, but no recorder publishes /pkm/recorder/tick'


def test_refusal_by_the_cell_ends_the_goal_with_its_reason(cell_of, client):
    cell = cell_of()
    cell.ended.set_result('machine: the machine has stopped: enough; call the service machine/reset first')
    status, message = client.end(client.send(joints=['d3']))
    assert status == GoalStatus.STATUS_ABORTED
    assert message == 'd3_slow_moves: ' + cell.ended.result()


def test_end_of_the_generator_in_a_cycle_ends_the_goal(cell_of, client):
    cell = cell_of()
    goal = client.send(joints=['d3'])
    cell.wait_for_goal()
    cell.close()
    status, message = client.end(goal)
    assert status == GoalStatus.STATUS_ABORTED
    assert message == 'd3_slow_moves: the trajectory_generator is gone; start it again'


def test_second_goal_is_refused_while_one_runs(cell_of, client):
    cell = cell_of()
    first = client.send()
    cell.wait_for_goal()
    assert client.end(client.send()) == (
        GoalStatus.STATUS_ABORTED,
        'another goal of identify is running; wait for its end or cancel it',
    )
    cell.ended.set_result('enough')
    client.end(first)


def test_feedback_names_the_running_experiment(graph, cell_of, client):
    cell = cell_of()
    goal = client.send(joints=['d3'])
    experiment = cell.wait_for_goal().experiment
    graph.spin_until(lambda: client.feedback, 'feedback')
    feedback = client.feedback[0]
    assert (feedback.phase, feedback.joint, feedback.experiment) == (feedback.MOVING, 'd3', 'd3_slow_moves')
    assert (experiment.motion, list(experiment.coordinates)) == ('d3_slow_moves', list(JOINTS))
    cell.ended.set_result('enough')
    client.end(goal)


@pytest.mark.parametrize('started', [True, False])
def test_cancelled_goal_stops_the_cycle(graph, cell_of, client, started):
    """At once, or at its start if it has not started."""
    cell = cell_of()
    goal = client.send()
    cell.wait_for_goal()
    if started:
        cell.tell(CycleEvent.STARTED, 1)
        graph.next_event(CycleEvent.STARTED)
    cancelled = goal.cancel_goal_async()
    graph.spin_until(cancelled.done, 'the answer to the cancellation')
    if not started:
        cell.tell(CycleEvent.STARTED, 1)
    stop = graph.next_event(CycleEvent.STOP, cycle=1)
    assert (stop.source, stop.message) == ('identification', 'identification was cancelled')
    cell.ended.set_result('machine: identification: identification was cancelled')
    status, message = client.end(goal)
    assert status == GoalStatus.STATUS_CANCELED
    assert message == 'd1_slow_moves: machine: identification: identification was cancelled'
