"""The recording of a cell without ROS: serialized messages in, bags and what has become of them out."""

import json
import resource
import shutil
import struct
from contextlib import contextmanager
from hashlib import sha256
from itertools import groupby

import numpy as np
import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.message_types import typestore
from pkm_core.bag.reader import column, raw_messages, read_metadata, read_topics
from pkm_core.bag.repair import repair
from pkm_core.errors import BagError, PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.laser_clock import sample_numbers
from pkm_core.recording import recording as module
from pkm_core.recording.cycle import file_name
from pkm_core.recording.folder_lock import FolderLock
from pkm_core.recording.recording import Recording
from pkm_core.recording.topics import recorded_topics

JOINTS = ('d1', 'd3', 'd5', 'd7')
SAMPLES = 60
MACHINE = load_machine('four_dof')
TS = 5e-4
LASER_TS = 8e-4
EVENT = 'pkm_interfaces/msg/CycleEvent'


class Cell:
    """A cell in which everything arrives in order, one cycle after the other."""

    def __init__(self, folder, preroll=1.0):
        self.topics = {f'/pkm/{topic.name}': topic for topic in recorded_topics(JOINTS) if topic.name[0] != '/'}
        self.warnings, self.offered = [], set(self.topics)
        facts = {'machine': 'four_dof', 'git_revision': '0123abc'}
        self.recording = Recording(
            folder,
            self.topics,
            MACHINE,
            preroll,
            lambda motion, law: facts | {'asked': motion + law},
            self.warnings.append,
            lambda topic: topic in self.offered,
        )
        self._types = typestore()

    def say(self, topic, **fields):
        kind = self.topics[f'/pkm/{topic}'].kind
        types = self._types.types
        self.deliver(topic, bytes(self._types.serialize_cdr(types[kind](**fields), kind)))

    def deliver(self, topic, data):
        self.recording.takers[f'/pkm/{topic}'](data)

    def tell(self, event, cycle, tick=0, samples=SAMPLES, message=''):
        number = getattr(self._types.types[EVENT], event)
        fields = {'source': 'machine', 'cycle': cycle, 'tick': tick, 'samples': samples, 'bag': '', 'message': message}
        self.say('cycle_events', event=number, **fields)

    def load(self, cycle, motion='short'):
        values = {name: np.zeros(4 * SAMPLES) for name in ('position', 'velocity', 'acceleration', 'jerk')}
        moves = {name: np.array([1], dtype=np.uint32) for name in ('move_starts', 'move_ends')}
        for topic in ('pose', 'joint'):
            self.say(
                f'{topic}_trajectory',
                **{'cycle': cycle, 'kind': 0, 'motion': motion, 'learning_law': 'fourier', 'sample_time': TS},
                coordinates=list(JOINTS),
                **values,
                **moves,
                feedforward=np.zeros(0),
            )

    def tick(self, cycle, tick, index, without=(), feedforward=0.0):
        for joint in JOINTS:
            same = {'tick': tick, 'cycle': cycle}
            if f'{joint}/encoder' not in without:
                self.say(f'{joint}/encoder', **same, index=index, mode=0, counts=tick, position=0.0)
            if f'{joint}/command' not in without:
                self.say(f'{joint}/command', **same, voltage=1.0, error=0.0, feedforward=feedforward)
        if tick % 20 == 0:
            self.states(tick)
        for number in sample_numbers(MACHINE, tick, tick + 1):
            self.say('laser', time=number * LASER_TS, displacement=np.zeros(4))

    def states(self, tick):
        types = self._types.types
        nanoseconds = round(tick * TS * 1e9)
        stamp = types['builtin_interfaces/msg/Time'](sec=0, nanosec=nanoseconds)
        header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='base')
        point, turn = types['geometry_msgs/msg/Point'](x=0.0, y=0.0, z=0.0), {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 1.0}
        pose = types['geometry_msgs/msg/Pose'](
            position=point, orientation=types['geometry_msgs/msg/Quaternion'](**turn)
        )
        self.say('pose', header=header, pose=pose)
        none = np.zeros(0)
        self.say('joint_states', header=header, name=[], position=none, velocity=none, effort=none)

    def run(self, cycle, first, *, without=None, feedforward=lambda index: 0.0, end=SAMPLES):
        """Run `cycle` from tick `first`; `without` names, by index, topics whose message does not come."""
        self.tell('STARTED', cycle, first)
        for index in range(end):
            self.tick(cycle, first + index, index, (without or {}).get(index, ()), feedforward(index))
        self.recording.sort()

    def finish(self, cycle, end):
        for joint in JOINTS:
            values = {'max_dynamic_error': 0.0, 'settling_time_5um': 0.0, 'settling_time_1um': 0.0}
            self.say(f'{joint}/cycle_metrics', cycle=cycle, joint=joint, **values, steady_state_error=0.0)
        self.tell('FINISHED', cycle, end)

    def play(self, cycle, first, **options):
        self.load(cycle)
        self.run(cycle, first, **options)
        self.finish(cycle, first + SAMPLES)

    def outcome(self):
        """Return the only outcome there is, and forget it."""
        [outcome] = self.recording.outcomes
        self.recording.outcomes.clear()
        return outcome


class SlowCell(Cell):
    """A cell whose messages come late and many at a time, those of the servo tick first, topic by topic."""

    def __init__(self, folder):
        super().__init__(folder)
        self._late = {topic.removeprefix('/pkm/'): [] for topic in self.topics}

    def deliver(self, topic, data):
        self._late[topic].append(data)

    def arrive(self):
        for topic, messages in self._late.items():
            for size, alike in groupby(messages, key=len):
                super().deliver(topic, np.frombuffer(b''.join(alike), np.uint8).reshape(-1, size))
            messages.clear()
        self.recording.sort()


@pytest.fixture
def cell(tmp_path):
    return Cell(tmp_path)


@pytest.fixture
def slow_cell(tmp_path):
    return SlowCell(tmp_path)


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(module, 'STRAGGLERS', -1.0)


@contextmanager
def no_file_beyond(size):
    """Let the system refuse to make any file of this program larger than `size` [bytes], as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_metadata_say_what_was_recorded_and_how_it_ended(cell):
    cell.play(1, 0, feedforward=lambda index: 0.1 * index)
    outcome = cell.outcome()
    assert (outcome.failure, outcome.lost, outcome.lost_ticks) == ('', {}, {})
    data = read_metadata(outcome.path)['custom_data']
    assert (data['machine'], data['git_revision']) == ('four_dof', '0123abc')
    assert (data['motion'], data['cycle'], data['learning_law']) == ('short', '1', 'fourier')
    assert data['asked'] == 'shortfourier'
    assert float(data['sample_time_s']) == TS
    assert data['end'] == 'finished'
    assert json.loads(data['lost']) == json.loads(data['lost_ticks']) == {}
    expected = json.loads(data['expected'])
    assert expected['/pkm/d5/command'] == SAMPLES
    assert expected['/pkm/pose'] == 3
    assert expected['/pkm/laser'] == 38, '30 ms, the first at 0'

    learned = json.loads(data['learned_feedforward'])
    sent = column(read_topics(outcome.path)['/pkm/d3/command'], 'feedforward')
    assert learned['/pkm/d3/command'] == sha256(sent.tobytes()).hexdigest()[:12]
    assert set(sent) == {0.1 * index for index in range(SAMPLES)}


def test_feedforward_before_any_learning_has_no_version(cell):
    cell.play(1, 0)
    learned = json.loads(read_metadata(cell.outcome().path)['custom_data']['learned_feedforward'])
    assert learned == {f'/pkm/{joint}/command': '' for joint in JOINTS}


def test_cycles_that_come_late_and_in_one_block_are_told_apart(slow_cell):
    slow_cell.load(1)
    slow_cell.run(1, 40, end=10)
    slow_cell.arrive()
    for index in range(10, SAMPLES):
        slow_cell.tick(1, 40 + index, index)
    slow_cell.finish(1, 40 + SAMPLES)
    slow_cell.play(2, 40 + SAMPLES, feedforward=lambda index: 0.1 * index)
    slow_cell.arrive()
    assert slow_cell.recording.progress == 40 + 2 * SAMPLES - 1
    outcomes = slow_cell.recording.outcomes
    assert [(o.cycle, o.failure, o.lost) for o in outcomes] == [(1, '', {}), (2, '', {})]
    for number, outcome in enumerate(outcomes):
        first = 40 + number * SAMPLES
        assert read_cycle(outcome.path).ticks.tolist() == list(range(first, first + SAMPLES))
        for topic, _, data, time in raw_messages(outcome.path):
            if topic.endswith(('encoder', 'command')):
                assert time == struct.unpack_from('<Q', data, 4)[0] * 500_000
    assert read_cycle(outcomes[1].path).feedforward[:, 2].tolist() == [0.1 * index for index in range(SAMPLES)]
    assert slow_cell.warnings == []


def test_block_of_late_messages_is_warned_of_one_by_one_and_costs_the_others_nothing(slow_cell):
    slow_cell.play(1, 0)
    slow_cell.arrive()
    for tick in range(3):
        slow_cell.tick(1, SAMPLES - 3 + tick, 0)
    slow_cell.play(2, SAMPLES)
    slow_cell.arrive()
    late = [text for text in slow_cell.warnings if 'of cycle 1 came after its bag was closed' in text]
    assert len(late) == 3 * 2 * len(JOINTS)
    assert [(o.cycle, o.lost) for o in slow_cell.recording.outcomes] == [(1, {}), (2, {})]
    assert read_cycle(slow_cell.recording.outcomes[1].path).is_whole


def test_cell_without_laser_and_with_a_controller_that_tells_no_metrics_loses_nothing(cell):
    silent = {'/pkm/laser', '/pkm/d3/cycle_metrics'}
    cell.offered -= silent
    say = cell.say
    cell.say = lambda topic, **fields: f'/pkm/{topic}' in silent or say(topic, **fields)
    cell.play(1, 0)
    outcome = cell.outcome()  # there is one already: nobody waits for stragglers
    assert outcome.lost == {}
    expected = json.loads(read_metadata(outcome.path)['custom_data']['expected'])
    assert not silent & expected.keys()
    assert expected['/pkm/d1/cycle_metrics'] == 1


@pytest.mark.usefixtures('impatient')
def test_what_is_lost_is_accounted_for_tick_by_tick(cell):
    without = {7: ['d1/encoder'], 8: ['d1/encoder'], 30: ['d1/encoder', 'd7/command'], 59: ['d7/command']}
    cell.play(1, 100, without=without)
    cell.recording.close_late()
    outcome = cell.outcome()
    lost, ticks = (
        {'/pkm/d1/encoder': 3, '/pkm/d7/command': 2},
        {
            '/pkm/d1/encoder': [[107, 108], [130, 130]],
            '/pkm/d7/command': [[130, 130], [159, 159]],
        },
    )
    assert (outcome.lost, outcome.lost_ticks) == (lost, ticks)
    data = read_metadata(outcome.path)['custom_data']
    assert (json.loads(data['lost']), json.loads(data['lost_ticks'])) == (lost, ticks)


def test_safe_stop_has_no_commands_to_lose_and_says_why_it_ended(cell):
    cell.load(1)
    cell.run(1, 0, end=10)
    for tick in range(10, 30):
        cell.tick(1, tick, 10, without=[f'{joint}/command' for joint in JOINTS])
    cell.tell('FAULT', 1, 30, samples=10, message='no answer from d3')
    outcome = cell.outcome()
    assert outcome.lost == {}
    assert read_metadata(outcome.path)['custom_data']['end'] == 'fault: no answer from d3'
    assert cell.recording.progress == 29, 'or the machine would wait for commands that never come'


def test_bag_whose_recorder_ends_first_is_whole_and_says_so(cell):
    cell.load(1)
    cell.run(1, 0, end=10)
    cell.recording.close_all()
    outcome = cell.outcome()
    assert read_metadata(outcome.path)['custom_data']['end'].startswith('interrupted: the recorder ended')
    assert len(read_cycle(outcome.path).ticks) == 10


def test_cycle_whose_machine_never_told_its_end_is_closed_when_the_next_one_starts(cell):
    cell.load(1)
    cell.run(1, 0, end=10)
    cell.load(2)
    cell.run(2, 0)
    outcome = cell.outcome()
    assert outcome.cycle == 1
    assert 'cycle 2 started' in read_metadata(outcome.path)['custom_data']['end']
    cell.finish(2, SAMPLES)
    assert read_cycle(cell.outcome().path).is_whole


def test_stopped_recording_finishes_its_cycle_and_says_of_the_next_that_it_is_not_recorded(cell):
    cell.load(1)
    cell.run(1, 0)
    assert cell.recording.stop() == 'stopped; cycle 1 is recorded to its end'
    assert cell.recording.stop() == 'stopped already', 'a second client changes nothing'
    cell.finish(1, SAMPLES)
    assert read_cycle(cell.outcome().path).is_whole

    cell.load(2)
    cell.run(2, SAMPLES)
    outcome = cell.outcome()
    assert (outcome.cycle, outcome.path) == (2, None)
    assert outcome.failure == 'recording is stopped; the service recorder/record starts it again'
    assert cell.recording.start() == 'recording from the next cycle on; cycle 2 is running and stays unrecorded'
    assert cell.recording.start() == 'recording already'
    cell.finish(2, 2 * SAMPLES)
    assert cell.recording.progress == 2 * SAMPLES - 1
    cell.play(3, 2 * SAMPLES)
    assert read_cycle(cell.outcome().path).is_whole


def test_split_goes_on_in_a_new_file_and_the_cycle_reads_as_one(cell):
    with pytest.raises(BagError, match='no bag is open'):
        cell.recording.split()
    cell.load(1)
    cell.run(1, 0)
    assert 'cycle 1 goes on in a new file of ' in cell.recording.split()
    cell.finish(1, SAMPLES)
    path = cell.outcome().path
    assert len(list(path.glob('*.mcap'))) == 2
    record = read_cycle(path)
    assert record.is_whole
    assert record.recorded['/pkm/d7/cycle_metrics'] == 1


def test_snapshot_holds_the_last_moments_also_while_recording_is_stopped(tmp_path):
    cell = Cell(tmp_path, preroll=0.02)
    with pytest.raises(BagError, match='no message of the servo tick has come yet'):
        cell.recording.snapshot()
    cell.recording.stop()
    cell.play(1, 0)
    path = cell.recording.snapshot()
    assert path.parent == tmp_path / 'snapshots'
    messages = read_topics(path)
    for joint in JOINTS:
        assert column(messages[f'/pkm/{joint}/encoder'], 'tick').tolist() == list(range(SAMPLES - 40, SAMPLES))
    assert len(messages['/pkm/joint_trajectory']) == 1
    assert read_metadata(path)['custom_data']['snapshot'] == 'ticks 20 to 59'
    assert cell.recording.snapshot() != path, 'nothing is overwritten'


def test_write_that_fails_costs_its_cycle_alone_and_is_told_once(cell):
    rng = np.random.default_rng(1)
    noise = lambda index: rng.standard_normal()  # noqa: E731 - the chunks must not shrink to nothing
    cell.load(1)
    with no_file_beyond(4000):
        for start in range(0, 600, SAMPLES):
            cell.run(1, start, feedforward=noise)
        outcome = cell.outcome()
        assert outcome.failure.startswith(f'{outcome.path}: File too large; ')
        assert outcome.failure.endswith(f'can be had by: pkm bag-doctor {outcome.path}')
        cell.finish(1, 600)
    assert cell.recording.outcomes == []
    cell.play(2, 600)
    assert read_cycle(cell.outcome().path).is_whole


@pytest.mark.parametrize('end', [200, 220, 240])
def test_recorder_that_is_killed_leaves_the_same_ticks_of_every_topic(cell, tmp_path, end):
    """What waited was written topic by topic, and a chunk ended somewhere."""
    cell.load(1)
    cell.run(1, 0, end=end)
    [left] = tmp_path.glob('*/*.mcap')
    copy = tmp_path / 'copy' / left.parent.name
    copy.mkdir(parents=True)
    shutil.copy(left, copy)
    messages = read_topics(repair(copy).path)
    for joint in JOINTS:
        for kind in ('encoder', 'command'):
            assert column(messages[f'/pkm/{joint}/{kind}'], 'tick').tolist() == list(range(end))


def test_bag_that_cannot_be_finished_is_told(cell):
    cell.load(1)
    cell.run(1, 0)
    with no_file_beyond(1):
        cell.finish(1, SAMPLES)
    assert 'File too large' in cell.outcome().failure


def test_folder_that_has_gone_is_told_and_leaves_no_empty_bag(tmp_path):
    folder = tmp_path / 'bags'
    folder.touch()
    cell = Cell(folder)
    cell.play(1, 0)
    assert cell.outcome().failure == f'{folder}: Not a directory'


@pytest.mark.parametrize(
    ('motion', 'name'),
    [
        ('four_dof_70ms', 'four_dof_70ms'),
        ('../../etc/passwd', '_.._etc_passwd'),
        ('.hidden', 'hidden'),
        ('kreis über 3 mm', 'kreis__ber_3_mm'),
        ('', 'motion'),
        ('a' * 300, 'a' * 80),
    ],
)
def test_motion_of_any_name_gives_a_folder_that_stays_where_it_is_put(motion, name):
    assert file_name(motion) == name


def test_bag_of_a_motion_with_a_path_for_a_name_stays_in_the_folder(cell, tmp_path):
    cell.load(1, motion='../x\n')
    cell.run(1, 0)
    cell.finish(1, SAMPLES)
    path = cell.outcome().path
    assert path.parent == tmp_path
    assert read_metadata(path)['custom_data']['motion'] == '../x\n'


def test_two_bags_of_one_cycle_in_one_second_do_not_meet(cell):
    cell.play(1, 0)
    first = cell.outcome().path
    cell.play(1, 0)  # a generator and a machine that were both started anew
    second = cell.outcome().path
    assert first != second
    assert read_cycle(first).is_whole
    assert read_cycle(second).is_whole


def test_late_and_early_messages_are_warned_of(cell):
    cell.play(1, 0)
    cell.outcome()
    cell.tick(1, 5, 5, without=[f'{joint}/{kind}' for joint in JOINTS for kind in ('encoder', 'command')][1:])
    cell.recording.sort()
    assert cell.warnings == ['/pkm/d1/encoder: a message of cycle 1 came after its bag was closed; not recorded']


def test_message_that_knows_no_tick_goes_into_the_cycle_that_runs(tmp_path):
    topics = recorded_topics(JOINTS)
    cell = Cell(tmp_path)
    diagnostics = next(topic for topic in topics if topic.name == '/diagnostics')
    cell.recording = Recording(
        tmp_path,
        cell.topics | {'/diagnostics': diagnostics},
        MACHINE,
        1.0,
        lambda *_: {},
        cell.warnings.append,
        lambda topic: True,
    )
    take, types = cell.recording.takers['/diagnostics'], typestore()
    of_node = {}
    for name in ('/pkm/machine', '/pkm_2/machine', '/left/pkm/machine'):
        fields = {'level': 0, 'message': '', 'hardware_id': '', 'values': []}
        status = types.types['diagnostic_msgs/msg/DiagnosticStatus'](name=name, **fields)
        header = types.types['std_msgs/msg/Header'](types.types['builtin_interfaces/msg/Time'](0, 0), '')
        array = types.types[diagnostics.kind](header=header, status=[status])
        of_node[name] = bytes(types.serialize_cdr(array, diagnostics.kind))
    take(of_node['/pkm/machine'])  # while nothing runs
    cell.load(1)
    cell.run(1, 0, end=10)
    for data in of_node.values():  # the last two are of other cells in the same graph
        take(data)
    cell.recording.close_all()
    [(topic, _, data, time)] = raw_messages(cell.outcome().path, ['/diagnostics'])
    assert (topic, bytes(data), time) == ('/diagnostics', of_node['/pkm/machine'], 9 * 500_000)


def test_second_recorder_on_a_folder_is_refused_until_the_first_has_ended(tmp_path):
    first = FolderLock(tmp_path / 'bags')
    with pytest.raises(BagError, match=r'bags: another recorder writes its bags there; stop it or name another folder'):
        FolderLock(tmp_path / 'bags')
    FolderLock(tmp_path / 'others').release()
    first.release()
    FolderLock(tmp_path / 'bags').release()


def test_folder_that_cannot_be_written_is_refused():
    with pytest.raises(PkmError, match='/proc/nowhere: cannot be written'):
        FolderLock('/proc/nowhere')
