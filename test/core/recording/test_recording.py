"""The services of a recording: stop, split and snapshot, and what a killed recorder leaves."""

import shutil

import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.pieces import EXTENDED
from pkm_core.bag.reader import column, read_metadata, read_topics
from pkm_core.bag.repair import repair
from pkm_core.errors import BagError
from support.recorded_cell import JOINTS, SAMPLES, Cell


def test_stop_takes_effect_after_the_running_cycle(cell):
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


def test_split_bag_reads_as_one_cycle(cell):
    with pytest.raises(BagError, match='no bag is open'):
        cell.recording.split()
    cell.load(1)
    cell.run(1, 0)
    assert 'cycle 1 continues in a new file of ' in cell.recording.split()
    cell.finish(1, SAMPLES)
    path = cell.outcome().path
    assert len(list(path.glob('*.mcap'))) == 2
    record = read_cycle(path)
    assert record.is_whole
    assert record.recorded['/pkm/d7/cycle_metrics'] == 1


def test_jog_of_several_pieces_reads_as_one_cycle(cell):
    """The piece at sample 30 came too late: the machine has driven the end of the one before."""
    cell.load(1, 'jog', samples=40, hold=10)
    cell.tell('STARTED', 1, 0)
    for index in range(SAMPLES):
        if index == 5:
            cell.load(1, 'jog', samples=SAMPLES - 10, offset=10, hold=30, position=1e-3)
        if index == 31:
            cell.load(1, 'jog', samples=SAMPLES, offset=30, hold=50, position=2e-3)
        cell.tick(1, index, index, mode=EXTENDED if index == 10 else 0)
    cell.tell('EXTENDED', 1, 10, samples=SAMPLES)
    cell.recording.sort()
    snapshot = cell.recording.snapshot()
    cell.finish(1, SAMPLES)
    outcome = cell.outcome()
    assert (outcome.lost, outcome.surplus, cell.warnings) == ({}, {}, [])
    record = read_cycle(outcome.path)
    assert record.is_whole
    assert (record.motion, record.samples) == ('jog', SAMPLES)
    for rows in (record.reference, record.pose_reference):
        assert rows[:, 0].tolist() == [0.0] * 10 + [1e-3] * 50
    assert (record.move_starts.tolist(), record.move_ends.tolist()) == ([0], [11])
    assert read_cycle(snapshot).reference[:, 0].tolist() == [0.0] * 10 + [1e-3] * 50
    assert repair(outcome.path) is None


@pytest.mark.parametrize('place', ['before the first tick', 'after the end'])
def test_piece_may_overtake_or_follow_messages_of_other_topics(cell, place):
    """The recorder reads topic by topic: a driven piece may be read before STARTED or after FINISHED."""
    cell.load(1, 'jog', samples=40, hold=10)

    def take_piece():
        cell.load(1, 'jog', samples=SAMPLES - 10, offset=10, hold=30, position=1e-3)

    if place == 'before the first tick':
        take_piece()
    cell.tell('STARTED', 1, 0)
    for index in range(SAMPLES):
        cell.tick(1, index, index, mode=EXTENDED if index == 10 else 0)
    cell.tell('EXTENDED', 1, 10, samples=SAMPLES)
    cell.finish(1, SAMPLES)
    if place == 'after the end':
        cell.recording.sort()
        assert not cell.recording.outcomes, 'its piece is missing'
        take_piece()
    cell.recording.sort()
    outcome = cell.outcome()
    assert (outcome.lost, outcome.surplus, cell.warnings) == ({}, {}, [])
    assert read_cycle(outcome.path).reference[:, 0].tolist() == [0.0] * 10 + [1e-3] * 50


def test_piece_that_was_not_driven_is_dropped_after_the_end(cell):
    cell.load(1, 'jog', hold=10)
    cell.run(1, 0)
    cell.tell('FINISHED', 1, SAMPLES)
    cell.load(1, 'jog', offset=50, hold=60)
    cell.finish(1, SAMPLES)
    assert cell.outcome().surplus == {}


@pytest.mark.parametrize('cycle', [1, 7])
def test_piece_of_a_closed_or_unknown_jog_is_not_recorded(cell, cycle):
    cell.load(1, 'jog', hold=10)
    cell.run(1, 0)
    cell.finish(1, SAMPLES)
    cell.outcome()
    cell.load(cycle, 'jog', offset=50, hold=60)
    assert len(cell.warnings) == 2
    assert f'a piece of cycle {cycle}, whose bag is closed or lacks the first one' in cell.warnings[0]


def test_jog_whose_driven_piece_is_missing_is_refused(cell):
    cell.load(1, 'jog', hold=10)
    cell.tell('STARTED', 1, 0)
    for index in range(SAMPLES):
        cell.tick(1, index, index, mode=EXTENDED if index == 10 else 0)
    cell.finish(1, SAMPLES)
    cell.recording.sort()
    with pytest.raises(BagError, match=r'joint_trajectory: the pieces of the jog at samples \[10\] are missing'):
        read_cycle(cell.outcome().path)


def test_snapshot_works_while_recording_is_stopped(tmp_path):
    cell = Cell(tmp_path, preroll=0.02)
    with pytest.raises(BagError, match='no message of the servo tick has arrived yet'):
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


@pytest.mark.parametrize('end', [200, 220, 240])
def test_killed_recorder_leaves_equal_ticks_per_topic(cell, tmp_path, end):
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
