"""Records: a bag as arrays, and what is no cycle of this cell."""

import re

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.message_types import typestore
from pkm_core.bag.reader import read_topics
from pkm_core.bag.writer import BagWriter
from pkm_core.config import install_prefixes
from pkm_core.errors import BagError
from pkm_core.motion.metrics import axis_metrics

TOPICS = ['/pkm/joint_trajectory', '/pkm/cycle_events']


@pytest.fixture
def older_types():
    """Return the message types before SampledTrajectory had `kind` and CycleEvent had `bag`."""
    store = get_typestore(Stores.ROS2_JAZZY)
    folder = next(prefix / 'share' / 'pkm_interfaces' / 'msg' for prefix in install_prefixes())
    for path in folder.glob('*.msg'):
        text = re.sub(r'^(uint8 kind|string bag) .*$', '', path.read_text(encoding='utf-8'), flags=re.MULTILINE)
        store.register(get_types_from_msg(text, f'pkm_interfaces/msg/{path.stem}'))
    return store


def test_bag_of_an_older_version_is_read(start_recording, make_cycle, older_types):
    """A bag carries the definitions of its messages; the arrays need no newer field."""
    cycle = make_cycle()
    recording = start_recording(cycle, 7, types=older_types)
    recording.ticks()
    recording.event(2, len(cycle.joints))
    path = recording.close()
    (trajectory,), (event,) = read_topics(path, TOPICS).values()
    assert not hasattr(trajectory, 'kind')
    assert not hasattr(event, 'bag')
    record = read_cycle(path)
    assert (record.cycle, record.motion, record.learning_law) == (7, 'short', 'fourier')
    assert np.array_equal(record.error, cycle.error)


def test_record_holds_what_was_written(write_bag, make_cycle):
    cycle = make_cycle()
    record = read_cycle(write_bag(cycle, 7, first_tick=800, metadata={'motion': 'short', 'git_revision': '0123abc'}))
    assert (record.cycle, record.motion, record.learning_law, record.sample_time) == (7, 'short', 'fourier', 5e-4)
    assert record.joints == cycle.machine.joints
    assert record.coordinates == cycle.machine.coordinates
    assert record.is_whole
    assert record.ticks.tolist() == list(range(800, 1200))
    assert np.array_equal(record.error, cycle.error)
    assert np.array_equal(record.voltage, cycle.voltage)
    assert np.array_equal(record.reference, cycle.joints.position)
    assert np.array_equal(record.position, cycle.joints.position - cycle.error)
    assert np.array_equal(record.pose_reference, cycle.poses.position)
    assert record.counts.dtype == np.int64
    assert record.recorded['/pkm/d1/encoder'] == record.expected['/pkm/d1/encoder'] == 400
    assert record.facts == {'motion': 'short', 'git_revision': '0123abc'}
    assert record.laser_time.shape == (0,)
    assert record.laser.shape == (0, 4)


def test_metrics_are_those_of_each_axis(write_bag, make_cycle):
    cycle = make_cycle()
    record = read_cycle(write_bag(cycle))
    moves = (cycle.joints.move_starts, cycle.joints.move_ends, 5e-4)
    assert record.metrics() == [axis_metrics(error, *moves) for error in cycle.error.T]


def test_cycle_cut_short_is_not_whole(start_recording):
    recording = start_recording()
    recording.ticks(150)
    record = read_cycle(recording.close())
    assert not record.is_whole
    assert len(record.ticks) == len(record.reference) == 150
    assert record.samples == 400


def test_bag_without_any_tick_is_an_empty_cycle(start_recording):
    record = read_cycle(start_recording().close())
    assert record.error.shape == record.reference.shape == (0, 4)


@pytest.mark.parametrize('joints', [('d3',), ('d1', 'd3', 'd5', 'd7')])
def test_missing_tick_is_refused(start_recording, joints):
    recording = start_recording()
    for index in range(4):
        recording.tick(index, without=joints if index == 2 else ())
    with pytest.raises(BagError, match=f'the ticks of {joints[0]} have gaps'):
        read_cycle(recording.close())


def test_bag_of_somebody_else_is_refused(tmp_path):
    kind = 'std_msgs/msg/UInt32'
    bag = BagWriter(tmp_path / 'bag', {'/number': kind}, {})
    bag.write('/number', bytes(typestore().serialize_cdr(typestore().types[kind](data=1), kind)), 0)
    bag.close({})
    with pytest.raises(BagError, match='has no message on any /joint_trajectory; expected a bag of one cell'):
        read_cycle(bag.path)
