"""Node recorder: the test publishes whole cycles and reads the resulting bags."""

import json
import shutil
from collections import Counter
from functools import partial
from itertools import pairwise
from math import nan
from pathlib import Path
from time import monotonic

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.parameter import Parameter
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt64
from std_srvs.srv import Trigger

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.message_types import typestore
from pkm_core.bag.reader import read_metadata
from pkm_core.errors import BagError, ConfigError, PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.laser_clock import sample_numbers
from pkm_core.recording import cycles
from pkm_core.recording.provenance import config_hash, git_revision, loop_hash, machine_hash
from pkm_core.recording.topics import STATES_EVERY
from pkm_interfaces.msg import CycleEvent, CycleMetrics, EncoderSample, LaserSample, MotorCommand, SampledTrajectory
from pkm_nodes.messages.conversions import time_of_tick, trajectory_to_msg
from pkm_nodes.nodes.learning import LearningNode
from pkm_nodes.nodes.recorder import RecorderNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.runtime.node import PkmNode

JOINTS = ('d1', 'd3', 'd5', 'd7')
SAMPLES = 40  # of the short motion
TS = 5e-4


class Cell:
    """Publishers of all recorded topics."""

    def __init__(self, graph, machine, short_motion, joint_trajectory):
        self._machine = machine
        self._poses, self._joints = short_motion, joint_trajectory
        self._pose_trajectory = graph.publisher(SampledTrajectory, 'pose_trajectory')
        self._joint_trajectory = graph.publisher(SampledTrajectory, 'joint_trajectory')
        self._events = graph.publisher(CycleEvent, 'cycle_events')
        self._encoders = {joint: graph.publisher(EncoderSample, f'{joint}/encoder') for joint in JOINTS}
        self._commands = {joint: graph.publisher(MotorCommand, f'{joint}/command') for joint in JOINTS}
        self._metrics = {joint: graph.publisher(CycleMetrics, f'{joint}/cycle_metrics') for joint in JOINTS}
        self._laser = graph.publisher(LaserSample, 'laser')
        self._pose = graph.publisher(PoseStamped, 'pose')
        self._joint_states = graph.publisher(JointState, 'joint_states')

    def stop_leading(self, graph):
        graph.node.destroy_publisher(self._joint_trajectory)

    def tell(self, event, cycle, **fields):
        self._events.publish(CycleEvent(event=event, cycle=cycle, **fields))

    def load(self, cycle):
        self._pose_trajectory.publish(trajectory_to_msg(self._poses, cycle=cycle, motion='short', learning_law='none'))
        self._joint_trajectory.publish(self._joints(cycle))
        for joint in JOINTS:
            self.tell(CycleEvent.LOADED, cycle, source=joint, samples=SAMPLES)

    def start(self, cycle, first):
        self.tell(CycleEvent.STARTED, cycle, source='machine', tick=first, samples=SAMPLES)

    def tick(self, cycle, tick, index, *, mode=EncoderSample.RUN):
        for joint in JOINTS:
            self._encoders[joint].publish(EncoderSample(tick=tick, cycle=cycle, index=index, mode=mode, counts=tick))
            if mode == EncoderSample.RUN:
                self.command(joint, cycle, tick)
        if tick % STATES_EVERY == 0:
            self.state(tick)
        for number in sample_numbers(self._machine, tick, tick + 1):
            self._laser.publish(LaserSample(time=number * self._machine.laser_sample_time, displacement=[0.0] * 4))

    def command(self, joint, cycle, tick):
        self._commands[joint].publish(MotorCommand(tick=tick, cycle=cycle, voltage=0.5 * tick))

    def state(self, tick):
        for publisher, message in ((self._pose, PoseStamped()), (self._joint_states, JointState())):
            message.header.stamp = time_of_tick(tick, TS)
            publisher.publish(message)

    def finish(self, cycle, end):
        for joint in JOINTS:
            self._metrics[joint].publish(CycleMetrics(cycle=cycle, joint=joint))
        self.tell(CycleEvent.FINISHED, cycle, source='machine', tick=end, samples=SAMPLES)

    def play(self, cycle, first):
        """Publish a whole cycle from tick `first`."""
        self.load(cycle)
        self.start(cycle, first)
        for index in range(SAMPLES):
            self.tick(cycle, first + index, index)
        self.finish(cycle, first + SAMPLES)


@pytest.fixture
def cell(graph, machine, short_motion, joint_trajectory):
    return Cell(graph, machine, short_motion, joint_trajectory)


def bag_of(graph, cycle):
    """Wait until the bag of `cycle` is closed and return its path."""
    return Path(graph.next_event(CycleEvent.RECORDED, cycle=cycle).bag)


def counts_by_rosbags(bag):
    with AnyReader([bag], default_typestore=typestore()) as reader:
        return counted(connection.topic for connection, _, _ in reader.messages())


def counts_by_mcap(bag):
    with next(bag.glob('*.mcap')).open('rb') as stream:
        return counted(channel.topic for _, channel, _ in make_reader(stream).iter_messages())


def counted(topics):
    """Return the number of messages by topic, without the recorder's own diagnostics, which follow wall time."""
    return Counter(topic for topic in topics if topic != '/diagnostics')


def expected_counts(*, encoder=SAMPLES, command=SAMPLES, metrics=1, states=2, laser=25, events=6):
    per_joint = {'encoder': encoder, 'command': command, 'cycle_metrics': metrics}
    counts = {f'/pkm/{joint}/{kind}': count for joint in JOINTS for kind, count in per_joint.items()}
    counts |= {f'/pkm/{topic}': 1 for topic in ('pose_trajectory', 'joint_trajectory')}
    counts |= {f'/pkm/{topic}': states for topic in ('pose', 'joint_states')} | {'/pkm/laser': laser}
    return {topic: count for topic, count in (counts | {'/pkm/cycle_events': events}).items() if count}


def nonzero(counts):
    return {topic: count for topic, count in counts.items() if count}


def test_bag_has_every_message_for_rosbags_and_mcap(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.play(1, 0)
    recorded = graph.next_event(CycleEvent.RECORDED)
    bag = Path(recorded.bag)
    assert list(tmp_path.iterdir()) == [bag]
    assert bag.name.startswith('short_0001_')
    assert counts_by_rosbags(bag) == counts_by_mcap(bag) == expected_counts()
    assert (recorded.source, recorded.cycle, recorded.samples) == ('recorder', 1, sum(expected_counts().values()))

    expected = json.loads(read_metadata(bag)['custom_data']['expected'])
    # the number of events is not fixed
    assert expected == {t: count for t, count in expected_counts().items() if t != '/pkm/cycle_events'}


class Neighbour(PkmNode):
    """Subscribes to the servo tick as controllers and motors do."""

    def __init__(self, **kwargs):
        super().__init__('neighbour', **kwargs)
        self.taken = Counter()
        for joint in JOINTS:
            for kind, message_type in (('encoder', EncoderSample), ('command', MotorCommand)):
                take = partial(self._on_message, f'/pkm/{joint}/{kind}')
                self.on_tick_topic(message_type, f'{joint}/{kind}', take, size=44)

    def _on_message(self, topic, data):
        self.taken[topic] += 1


def test_tick_topics_of_a_neighbour_are_tapped(graph, cell, tmp_path):
    neighbour = graph.start(Neighbour)
    graph.start(partial(RecorderNode, [neighbour]), folder=str(tmp_path))
    assert graph.node.count_subscribers('d1/encoder') == graph.node.count_subscribers('d7/command') == 1
    progress = graph.listen(UInt64, 'recorder/tick')
    graph.spin_until(lambda: progress, 'the word that it is connected')
    cell.play(1, 0)
    assert counts_by_mcap(bag_of(graph, 1)) == expected_counts()
    assert neighbour.taken == {t: SAMPLES for t in expected_counts() if t.endswith(('encoder', 'command'))}


def test_values_and_simulated_times_are_what_was_published(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.play(1, 60)
    bag, ticks = bag_of(graph, 1), range(60, 60 + SAMPLES)
    with AnyReader([bag], default_typestore=typestore()) as reader:
        connections = [c for c in reader.connections if c.topic == '/pkm/d3/command']
        commands = [(time, reader.deserialize(data, c.msgtype)) for c, time, data in reader.messages(connections)]
    assert [(time, m.tick, m.voltage) for time, m in commands] == [(500_000 * t, t, 0.5 * t) for t in ticks]
    with next(bag.glob('*.mcap')).open('rb') as stream:
        samples = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(['/pkm/d3/encoder'])
        assert [(raw.log_time, m.tick, m.counts) for _, _, raw, m in samples] == [(500_000 * t, t, t) for t in ticks]


def test_every_cycle_has_its_own_bag(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    for cycle in (1, 2, 3):
        cell.play(cycle, (cycle - 1) * SAMPLES)
    for cycle in (1, 2, 3):
        record = read_cycle(bag_of(graph, cycle))
        assert record.ticks.tolist() == list(range((cycle - 1) * SAMPLES, cycle * SAMPLES))
        assert nonzero(record.recorded) == expected_counts()
    assert len(list(tmp_path.iterdir())) == 3


def test_messages_after_the_end_of_a_cycle_are_waited_for(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.load(1)
    cell.start(1, 0)
    for index in range(SAMPLES - 1):
        cell.tick(1, index, index)
    cell.finish(1, SAMPLES)
    graph.spin_in_silence()
    cell.tick(1, SAMPLES - 1, SAMPLES - 1)
    assert counts_by_mcap(bag_of(graph, 1)) == expected_counts()


def test_missing_messages_are_named_and_the_bag_is_closed(graph, cell, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(cycles, 'STRAGGLERS', 0.2)
    graph.start(RecorderNode, folder=str(tmp_path))
    progress = graph.listen(UInt64, 'recorder/tick')
    cell.load(1)
    cell.start(1, 0)
    for index in range(SAMPLES - 1):
        cell.tick(1, index, index)
    graph.spin_until(lambda: progress and progress[-1].data == SAMPLES - 2, 'the progress of the recorder')
    cell.finish(1, SAMPLES)
    bag = bag_of(graph, 1)
    assert counts_by_mcap(bag) == expected_counts(encoder=SAMPLES - 1, command=SAMPLES - 1)
    said = capfd.readouterr().err
    assert "'/pkm/d1/encoder': 1," in said
    assert "'/pkm/d1/encoder': [[39, 39]]," in said


def test_cycle_cut_short_by_a_fault_is_closed_and_readable(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.load(1)
    cell.start(1, 0)
    for index in range(10):
        cell.tick(1, index, index)
    for tick in range(10, 30):
        cell.tick(1, tick, 10, mode=EncoderSample.SAFE_STOP)
    cell.tell(CycleEvent.FAULT, 1, source='machine', tick=30, samples=10, message='no answer')
    bag = bag_of(graph, 1)
    assert counts_by_rosbags(bag) == counts_by_mcap(bag) == expected_counts(encoder=30, command=10, metrics=0, laser=19)
    assert read_cycle(bag).ticks.tolist() == list(range(10))

    cell.play(2, 30)
    assert counts_by_mcap(bag_of(graph, 2)) == expected_counts()


def test_recorder_stopped_in_a_cycle_leaves_a_readable_bag(graph, cell, tmp_path):
    node = graph.start(RecorderNode, folder=str(tmp_path))
    progress = graph.listen(UInt64, 'recorder/tick')
    cell.load(1)
    cell.start(1, 0)
    for index in range(SAMPLES):
        cell.tick(1, index, index)
    graph.spin_until(lambda: progress and progress[-1].data == SAMPLES - 1, 'the progress of the recorder')
    graph.stop(node)
    (bag,) = tmp_path.iterdir()
    assert counts_by_rosbags(bag) == counts_by_mcap(bag) == expected_counts(metrics=0, events=5)


def test_late_message_does_not_disturb_the_next_cycle(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.load(1)
    cell.start(1, 0)
    cell.tick(1, 0, 0)
    for tick in (1, 2):
        cell.tick(1, tick, 1, mode=EncoderSample.SAFE_STOP)
    cell.tell(CycleEvent.FAULT, 1, source='machine', tick=3, samples=1, message='no answer from d3')
    bag_of(graph, 1)
    cell.load(2)
    graph.spin_in_silence()
    cell.command('d3', 1, 0)  # the late answer of the missing joint_controller
    graph.spin_in_silence()
    cell.start(2, 3)
    for index in range(SAMPLES):
        cell.tick(2, 3 + index, index)
    cell.finish(2, 3 + SAMPLES)
    assert nonzero(read_cycle(bag_of(graph, 2)).recorded) == expected_counts()
    assert len(list(tmp_path.iterdir())) == 2


def test_cycle_of_a_dead_machine_gets_no_later_messages(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.load(1)
    cell.start(1, 0)
    cell.tick(1, 0, 0)
    graph.spin_in_silence()
    cell.load(2)
    cell.start(2, 0)  # a restarted machine
    graph.spin_in_silence()
    for index in range(SAMPLES):
        cell.tick(2, index, index)
    cell.finish(2, SAMPLES)
    assert counts_by_mcap(bag_of(graph, 2)) == expected_counts()


def test_refused_cycle_leaves_no_bag(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.load(1)
    cell.tell(CycleEvent.REFUSED, 1, source='machine', message='lengths differ')
    cell.play(2, 0)
    bag = bag_of(graph, 2)
    assert list(tmp_path.iterdir()) == [bag]
    assert counts_by_mcap(bag) == expected_counts()


def test_resent_trajectory_is_recorded_once(graph, cell, tmp_path):
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.load(1)
    cell.load(1)
    cell.play(1, 0)
    assert counts_by_mcap(bag_of(graph, 1)) == expected_counts(events=14)


def test_recorder_reports_first_when_every_joint_is_connected(graph, tmp_path):
    progress = graph.listen(UInt64, 'recorder/tick')
    graph.start(RecorderNode, folder=str(tmp_path))
    graph.publisher(SampledTrajectory, 'joint_trajectory')
    for joint in JOINTS:
        graph.publisher(EncoderSample, f'{joint}/encoder')
    for joint in JOINTS[:3]:
        graph.publisher(MotorCommand, f'{joint}/command')
    graph.spin_in_silence()
    graph.spin_in_silence()
    assert not progress
    graph.publisher(MotorCommand, 'd7/command')
    graph.spin_until(lambda: progress, 'the first word of the recorder')
    assert progress[0].data == 0


def test_recorder_reports_the_tick_that_every_topic_has_reached(graph, cell, tmp_path):
    progress = graph.listen(UInt64, 'recorder/tick')
    graph.start(RecorderNode, folder=str(tmp_path))
    cell.load(1)
    cell.start(1, 0)
    for index in range(SAMPLES):
        cell.tick(1, index, index)
    graph.spin_until(lambda: progress and progress[-1].data == SAMPLES - 1, 'the progress of the recorder')
    assert all(a.data <= b.data for a, b in pairwise(progress))


def test_write_error_is_reported_and_next_cycle_recorded(graph, cell, tmp_path, capfd):
    folder = tmp_path / 'bags'
    progress = graph.listen(UInt64, 'recorder/tick')
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
    graph.start(RecorderNode, folder=str(folder))
    cell.play(1, 0)
    bag = bag_of(graph, 1)
    shutil.move(folder, tmp_path / 'elsewhere')
    folder.write_text('a file in the place of the folder')
    cell.play(2, SAMPLES)
    told = graph.next_event(CycleEvent.NOT_RECORDED, cycle=2)
    assert (told.source, told.message) == ('recorder', f'{folder}: Not a directory')
    graph.spin_until(lambda: progress and progress[-1].data == 2 * SAMPLES - 1, 'the progress of the recorder')
    assert f'not recorded: cycle 2: {folder}: Not a directory' in capfd.readouterr().err
    assert counts_by_mcap(tmp_path / 'elsewhere' / bag.name) == expected_counts()
    graph.spin_until(lambda: diagnostics and diagnostics[-1].status[0].level == b'\x02', 'an error in /diagnostics')
    assert diagnostics[-1].status[0].message == f'not recorded: cycle 2: {folder}: Not a directory'

    folder.unlink()
    cell.play(3, 2 * SAMPLES)
    assert counts_by_mcap(bag_of(graph, 3)) == expected_counts()
    graph.spin_until(lambda: diagnostics[-1].status[0].message == 'recording', 'the end of the error')


def test_services_stop_start_split_and_snapshot(graph, cell, tmp_path):
    progress = graph.listen(UInt64, 'recorder/tick')
    graph.start(RecorderNode, folder=str(tmp_path), preroll=0.01)

    def call(name):
        answer = graph.call(Trigger, f'recorder/{name}')
        return answer.success, answer.message

    assert call('split_bagfile') == (False, 'no bag is open: no cycle is being recorded')
    assert call('snapshot') == (False, 'snapshot: no message of the servo tick has arrived yet')
    assert call('stop') == (True, 'stopped')
    assert call('stop') == (True, 'stopped already')
    cell.play(1, 0)
    assert 'recorder/record starts it again' in graph.next_event(CycleEvent.NOT_RECORDED, cycle=1).message
    graph.spin_until(lambda: progress and progress[-1].data == SAMPLES - 1, 'the progress of the recorder')
    good, path = call('snapshot')
    assert good
    assert counts_by_rosbags(Path(path))['/pkm/d1/encoder'] == 20

    assert call('record') == (True, 'recording from the next cycle on')
    assert call('record') == (True, 'recording already')
    cell.load(2)
    cell.start(2, SAMPLES)
    for index in range(SAMPLES):
        cell.tick(2, SAMPLES + index, index)
    graph.spin_until(lambda: progress and progress[-1].data == 2 * SAMPLES - 1, 'the progress of the recorder')
    good, text = call('split_bagfile')
    assert good
    assert text.startswith('cycle 2 continues in a new file of ')
    cell.finish(2, 2 * SAMPLES)
    bag = bag_of(graph, 2)
    assert len(list(bag.glob('*.mcap'))) == 2
    assert read_cycle(bag).is_whole


def test_bag_lists_nodes_and_parameters(graph, cell, tmp_path):
    graph.start(LearningNode, machine='planar')
    graph.start(RecorderNode, folder=str(tmp_path / 'bags'))
    progress = graph.listen(UInt64, 'recorder/tick')
    graph.spin_until(lambda: progress, 'the first word of the recorder')
    cell.play(1, 0)
    data = read_metadata(bag_of(graph, 1))['custom_data']
    parameters = json.loads(data['parameters'])
    assert set(parameters) == {'test', 'learning', 'recorder'}
    assert parameters['learning']['machine'] == 'planar'
    assert parameters['recorder']['folder'] == str(tmp_path / 'bags')
    assert data['git_revision'] == git_revision()
    loop = loop_hash(load_machine('four_dof'), 'robust', machine_hash('four_dof'))
    assert data['config_hash'] == config_hash([loop], '', 'none'), 'no file of a motion "short"'


def test_recorder_is_ready_only_with_a_trajectory_source(graph, cell, tmp_path):
    """Trajectories of identification come from the trajectory_generator, of a motion from another node."""
    cell.stop_leading(graph)
    graph.start(TrajectoryGeneratorNode)
    graph.start(RecorderNode, folder=str(tmp_path))
    progress = graph.listen(UInt64, 'recorder/tick')
    looked_until = monotonic() + 1.5
    graph.spin_until(lambda: monotonic() > looked_until, 'some looks of the recorder at the graph')
    assert progress == []
    graph.publisher(SampledTrajectory, 'joint_trajectory')
    graph.spin_until(lambda: progress, 'the first word of the recorder')


class Tunable(PkmNode):
    """A node with a parameter that may be changed."""

    def __init__(self, **kwargs):
        super().__init__('tunable', **kwargs)
        self.tunable('gain', 1.0, 'to be changed')


def test_bag_has_parameters_as_changed_before_its_cycle(graph, cell, tmp_path):
    node = graph.start(Tunable)
    graph.start(RecorderNode, folder=str(tmp_path / 'bags'))
    progress = graph.listen(UInt64, 'recorder/tick')
    graph.spin_until(lambda: progress, 'the first word of the recorder')

    def recorded_gain(cycle):
        cell.play(cycle, (cycle - 1) * SAMPLES)
        return json.loads(read_metadata(bag_of(graph, cycle))['custom_data']['parameters'])['tunable']['gain']

    assert recorded_gain(1) == 1.0
    node.set_parameters([Parameter('gain', value=2.5)])
    graph.spin_in_silence()
    assert recorded_gain(2) == 2.5


def test_second_recorder_on_the_folder_is_refused(graph, tmp_path):
    node = graph.start(RecorderNode, folder=str(tmp_path))
    with pytest.raises(BagError, match=f'{tmp_path}: another recorder writes its bags there'):
        graph.start(RecorderNode, folder=str(tmp_path))
    graph.stop(node)
    graph.start(RecorderNode, folder=str(tmp_path))


def test_unwritable_folder_is_refused(graph, tmp_path):
    (tmp_path / 'file').touch()
    folder = tmp_path / 'file' / 'bags'
    with pytest.raises(PkmError, match=f'{folder}: cannot be written: Not a directory'):
        graph.start(RecorderNode, folder=str(folder))


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'preroll': nan}, 'recorder: preroll is nan; expected a positive, finite number'),
        ({'preroll': 0.0}, r'recorder: preroll is 0\.0; expected a positive, finite number'),
        ({'preroll': 1e9}, r'recorder: preroll is 1000000000\.0 s; allowed: at most 60 s'),
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown"),
        ({'fodler': 'here'}, r"/pkm/recorder has unknown parameter\(s\) \['fodler'\]; known: .*'folder'"),
    ],
)
def test_invalid_parameter_is_refused_by_name(graph, parameters, text, tmp_path):
    with pytest.raises(ConfigError, match=text):
        graph.start(RecorderNode, **{'folder': str(tmp_path)} | parameters)
