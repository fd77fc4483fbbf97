"""Messages are taken from one publisher per topic; the test takes as the lock-step executor does."""

from time import sleep

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from std_msgs.msg import UInt32, UInt64

from pkm_interfaces.msg import CycleEvent, MotorCommand, SampledTrajectory
from pkm_nodes.messages.tick_messages import UINT64
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.parts.cycle_events import EventGate, subscribe_events
from pkm_nodes.parts.intruders import Intruders, results_of
from pkm_nodes.parts.machine_status import StatusGate
from pkm_nodes.parts.speakers import Speakers
from pkm_nodes.runtime.groups import PatientGroup
from pkm_nodes.runtime.lockstep import LockstepExecutor
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import EVENT_QOS, LAST_VALUE_QOS, TICK_QOS, PkmNode
from pkm_nodes.runtime.patient_subscription import PatientSubscription


class Ear(PkmNode):
    """Hears numbers on the tick path and, patiently, as a recorder does."""

    def __init__(self):
        super().__init__('ear')
        self.hot, self.patient = [], []
        self.tick = self.on_tick_topic(UInt64, 'numbers', lambda data: self.hot.append(*UINT64.unpack(data)), size=12)
        self.queue = PatientSubscription(
            self,
            UInt64,
            'numbers',
            lambda rows: self.patient.extend(rows[:, 4].tolist()),
            TICK_QOS,
            PatientGroup(lambda: None),
        )


class Speaker:
    """A node with a publisher of numbers."""

    def __init__(self, name):
        self.node = rclpy.create_node(name, namespace='/pkm')
        self._publisher = self.node.create_publisher(UInt64, 'numbers', TICK_QOS)

    def say(self, *numbers):
        for number in numbers:
            self._publisher.publish(UInt64(data=number))
        assert self._publisher.wait_for_all_acked()

    def wait_for_two_readers(self, graph):
        graph.spin_until(lambda: self._publisher.get_subscription_count() == 2, 'both subscriptions')


@pytest.fixture
def ear(graph):
    ear = Ear()
    yield ear
    ear.destroy_node()


@pytest.fixture
def executor(graph, ear):
    executor = LockstepExecutor(context=rclpy.get_default_context())
    executor.add_node(ear)
    executor._gather()
    with executor._held:  # the entities that `spin` holds
        yield executor
    executor.shutdown()


@pytest.fixture
def speak(graph, ear):
    """Return a function that adds a connected speaker."""
    made = []

    def speak(name):
        made.append(Speaker(name))
        made[-1].wait_for_two_readers(graph)
        return made[-1]

    yield speak
    for each in made:
        each.node.destroy_node()


def test_second_publisher_is_not_heard_and_is_named(ear, executor, speak):
    first = speak('first')
    first.say(1)
    executor._run_flow()
    rogue = speak('rogue')
    rogue.say(7, 8, 9)
    first.say(2)
    executor._run_flow()
    assert ear.hot == ear.patient == [1, 2]
    assert ear.foreign_messages() == ear.queue.foreign == 3
    ear.tick.bind()
    assert ear.tick.publisher.others == ['/pkm/rogue']
    assert ear.tick.publisher.describe() == '/pkm/numbers has 2 publishers, /pkm/first, /pkm/rogue'


def test_successor_is_heard_from_its_first_message(graph, ear, executor, speak):
    first = speak('first')
    first.say(1)
    executor._run_flow()
    first.node.destroy_node()
    graph.spin_until(lambda: not graph.node.count_publishers('numbers'), 'the end of the first publisher')
    ear.tick._look_at = ear.queue._look_at = 0.0  # the looks at the graph are 50 ms apart
    speak('second').say(2, 3)
    executor._run_flow()
    assert ear.hot == ear.patient == [1, 2, 3]
    assert ear.foreign_messages() == ear.queue.foreign == 0


def test_several_unknown_publishers_are_all_heard(ear, executor, speak):
    """None of them is the first: the machine starts no cycle until all but one have left."""
    speakers = speak('one'), speak('other')
    for number, speaker in enumerate(speakers):
        speaker.say(number)
    executor._run_flow()
    assert sorted(ear.hot) == sorted(ear.patient) == [0, 1]
    assert not ear.tick.bind()


def test_event_is_believed_from_the_process_of_its_source(graph):
    """Another process has another participant in its GIDs; a source that publishes nothing is not in the graph."""
    speakers, foreign = Speakers(graph.node), b'x' * 16
    assert not speakers.is_genuine('FINISHED', 'machine', foreign), 'a flood that began before the cell'
    assert not speakers.is_genuine('RECORDED', 'recorder', foreign)
    graph.publisher(UInt32, 'machine/cycle', LAST_VALUE_QOS)
    info = graph.node.get_publishers_info_by_topic('machine/cycle')[0]
    speakers = Speakers(graph.node)
    of_this_process = bytes(info.endpoint_gid)[:12] + b'1234'
    assert speakers.is_genuine('FINISHED', 'machine', of_this_process)
    assert not speakers.is_genuine('FINISHED', 'machine', foreign)
    assert not speakers.is_genuine('FINISHED', 'd1', of_this_process)
    assert speakers.is_genuine('STOP', 'anyone', foreign)
    assert speakers.is_genuine('FINISHED', 'machine', b''), "rclpy's public API names no sender"


def test_machine_of_the_user_is_known_by_its_encoders(graph):
    """It need not publish machine/cycle."""
    graph.publisher(UInt64, 'd1/encoder')
    gid = bytes(graph.node.get_publishers_info_by_topic('d1/encoder')[0].endpoint_gid)
    assert Speakers(graph.node).is_genuine('FINISHED', 'machine', gid)
    assert not Speakers(graph.node).is_genuine('FINISHED', 'machine', b'x' * 16)


@pytest.fixture
def rogue(graph):
    """Return a node in another participant."""
    context = rclpy.Context()
    context.init(domain_id=graph.node.context.get_domain_id())
    rogue = rclpy.create_node('rogue', namespace='/pkm', context=context)
    yield rogue
    rogue.destroy_node()
    context.shutdown()


@pytest.fixture
def rogue_events(graph, ear, rogue):
    """Return a publisher of cycle events in another participant, connected to the ear."""
    publisher = rogue.create_publisher(CycleEvent, 'cycle_events', EVENT_QOS)
    graph.spin_until(lambda: publisher.get_subscription_count() == 1, 'the subscription of the test')
    return publisher


def test_flood_of_forged_events_is_dropped_unread(ear, executor, rogue_events):
    """One of each kind is judged, the others are dropped in compiled code, and all are counted."""
    heard = []
    gate = subscribe_events(ear, heard.append, kinds=(CycleEvent.FINISHED, CycleEvent.LOADED, CycleEvent.NOTICE))
    judged = []
    judge = gate._is_believed
    gate._is_believed = lambda *arguments: judged.append(arguments) or judge(*arguments)
    executor._gather()
    while rogue_events.get_subscription_count() < 2:
        sleep(0.01)
    kinds = [CycleEvent.FINISHED, CycleEvent.LOADED, CycleEvent.RESET, CycleEvent.NOTICE, CycleEvent.STOP]
    for number in range(1000):
        rogue_events.publish(CycleEvent(event=kinds[number % 5], source=('machine', 'd1')[number % 2], cycle=number))
    assert rogue_events.wait_for_all_acked()
    for _ in range(2000):
        executor._serve(executor._all, 0)
        gate.foreign += gate.denials.renew()
        if gate.foreign + len(heard) >= 600:
            break
        sleep(0.001)
    assert {event.event for event in heard} == {CycleEvent.NOTICE}
    assert 50 <= len(heard) <= 150, 'every process may report something, but not any number in a second'
    assert gate.foreign == 600 - len(heard)
    assert len(judged) < 200
    assert gate.foreign_nodes() == ['/pkm/rogue']
    assert gate.foreign_nodes() == [], 'named once'


def test_node_whose_event_came_before_its_publisher_is_own(graph, ear, rogue):
    """On a loaded computer the first event of a controller can arrive before the news of its publishers."""
    gate = EventGate(ear, '/pkm/cycle_events', ['d1'])
    rogue.create_publisher(CycleEvent, 'cycle_events', EVENT_QOS)
    graph.spin_until(lambda: ear.count_publishers('cycle_events'), 'the publisher of events')
    (info,) = ear.get_publishers_info_by_topic('cycle_events')
    gid = bytes(info.endpoint_gid)
    loaded = serialize_message(CycleEvent(event=CycleEvent.LOADED, source='d1', session=ear.session, cycle=1))
    assert gate.event_in(loaded, gid) is None
    assert gate.foreign == 1
    rogue.create_publisher(MotorCommand, 'd1/command', TICK_QOS)
    graph.spin_until(lambda: ear.count_publishers('d1/command'), 'the publisher of commands')
    assert gate.foreign_nodes() == []


def test_refusal_is_not_believed_from_a_later_publisher(graph, rogue):
    """A rogue on joint_trajectory and pose_trajectory is no source of refusals: both are known before it comes."""
    source = rclpy.create_node('source', namespace='/pkm')
    source.create_publisher(SampledTrajectory, 'pose_trajectory', TICK_QOS)
    graph.publisher(SampledTrajectory, 'joint_trajectory')
    graph.spin_until(lambda: graph.node.count_publishers('pose_trajectory'), 'the source')
    speakers = Speakers(graph.node)
    speakers._look_regularly()  # as every second
    for kind in ('pose', 'joint'):
        rogue.create_publisher(SampledTrajectory, f'{kind}_trajectory', TICK_QOS)

    def gids():
        infos = graph.node.get_publishers_info_by_topic('joint_trajectory')
        return [bytes(info.endpoint_gid) for info in infos if info.node_name == 'rogue']

    graph.spin_until(gids, 'the rogue')
    assert not speakers.is_genuine('REFUSED', 'd1', gids()[0])
    source.destroy_node()


def test_machine_status_is_believed_from_its_process(graph, capfd):
    """A forged sign of life, or a forged end of the cycle, is of another process than machine/cycle."""
    gate, foreign = StatusGate(graph.node), b'x' * 16
    status = [DiagnosticStatus(name='/pkm/recorder'), DiagnosticStatus(name='/pkm/machine', message='standing')]
    data, others = (serialize_message(DiagnosticArray(status=each)) for each in (status, status[:1]))
    assert gate.status_in(data, foreign) is None, 'no machine in the graph'
    graph.publisher(UInt32, 'machine/cycle', LAST_VALUE_QOS)
    own = bytes(graph.node.get_publishers_info_by_topic('machine/cycle')[0].endpoint_gid)[:12] + b'1234'
    gate = StatusGate(graph.node)
    assert gate.status_in(data, own).message == gate.status_in(data).message == 'standing'
    assert [gate.status_in(data, foreign), gate.status_in(others, own), gate.status_in(b'\0\1\0\0\1', own)] == 3 * [
        None
    ]
    lines = [line.partition('/diagnostics: ')[2] for line in capfd.readouterr().err.splitlines()]
    assert lines[0] == 'status of /pkm/machine dropped: not of the process of /pkm/machine/cycle'


def test_unreadable_events_are_dropped_with_one_line(graph, capfd):
    """Ten thousand of them neither end the node nor fill its log."""
    graph.start(TrajectoryGeneratorNode)
    events = graph.publisher(CycleEvent, 'cycle_events')
    for _ in range(300):
        events.publish(b'\0\1\0\0\1\2')
    graph.spin_in_silence()
    lines = [line for line in capfd.readouterr().err.splitlines() if 'is no CycleEvent' in line]
    assert 1 <= len(lines) <= 3


def test_log_lines_of_a_flood_are_counted(graph, capfd):
    """One line per topic and second; rclpy would raise for another severity logged by the same line of code."""
    warn, error = LogThrottle(graph.node.get_logger()), LogThrottle(graph.node.get_logger(), is_error=True)
    for _ in range(100):
        warn('a: bad')
        error('a: worse')
        warn('b: bad')
    warn._last['a'] = -1.0, warn._last['a'][1]
    warn('a: bad')
    lines = [line.partition('pkm.test]: ')[2] for line in capfd.readouterr().err.splitlines()]
    assert lines == ['a: bad', 'a: worse', 'b: bad', 'a: bad (and 99 more since the last line)']


@pytest.mark.parametrize(
    'name', ['laser', 'joint_correction', 'excitation', 'd1/cycle_metrics', 'd3/cycle_error', 'pose']
)
def test_second_publisher_of_results_starts_no_cycle(graph, name):
    """Figures, bags and learned corrections come from these topics: the machine wants one publisher each."""
    node = PkmNode('machine')
    gate = subscribe_events(node, lambda _: None)
    intruders = Intruders(node, [], gate, [], results_of(['d1', 'd3']))
    graph.publisher(UInt64, name)
    assert intruders.find() == ''
    rogue = rclpy.create_node('rogue', namespace='/pkm')
    rogue.create_publisher(UInt64, name, TICK_QOS)
    graph.spin_until(lambda: graph.node.count_publishers(name) == 2, 'the rogue')
    intruders.look()
    assert intruders.present == f'messages of further publishers are dropped: /pkm/{name}: /pkm/rogue'
    intruders._look_at = 0.0  # the looks at the graph are 0.5 s apart
    assert f'/pkm/{name} has 2 publishers, /pkm/rogue, /pkm/test' in intruders.find()
    rogue.destroy_node()
    node.destroy_node()
