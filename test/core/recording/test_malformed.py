"""Messages that are none of their type: they are reported and not recorded, and the cycle around them is."""

import math

import numpy as np
import pytest

from pkm_core.bag.integrity import is_whole
from support.recorded_cell import SAMPLES


@pytest.mark.parametrize('data', [b'', b'\0\1', b'\0\1\0\0' + bytes(12), b'\0\1\0\0' + bytes(200)], ids=len)
@pytest.mark.parametrize('topic', ['d1/encoder', 'd3/command', 'cycle_events', 'joint_trajectory', 'laser', 'pose'])
def test_malformed_message_does_not_reach_the_bag(cell, topic, data):
    cell.load(1)
    cell.tell('STARTED', 1, 0)
    for index in range(SAMPLES):
        cell.tick(1, index, index)
        if index == 30:
            cell.deliver(topic, data)
    cell.recording.sort()
    cell.finish(1, SAMPLES)
    outcome = cell.outcome()
    assert (outcome.failure, outcome.lost) == ('', {})


def test_malformed_messages_of_the_tick_are_named(cell):
    cell.load(1)
    cell.tell('STARTED', 1, 0)
    cell.deliver('d1/encoder', bytes(12))
    cell.deliver('d1/encoder', np.zeros((3, 60), np.uint8))
    for index in range(SAMPLES):
        cell.tick(1, index, index)
    cell.recording.sort()
    assert cell.warnings == [
        '/pkm/d1/encoder: message of 12 bytes; expected 44; not recorded',
        '/pkm/d1/encoder: message of 60 bytes; expected 44; not recorded',
    ]


def test_event_at_a_tick_beyond_all_times_is_not_recorded(cell):
    cell.load(1)
    cell.tell('STARTED', 1, 0)
    for event in ('NOTICE', 'FAULT', 'STARTED'):
        cell.tell(event, 1, (1 << 64) - 1)
    for index in range(SAMPLES):
        cell.tick(1, index, index)
    cell.finish(1, SAMPLES)
    outcome = cell.outcome()
    assert (outcome.failure, outcome.lost) == ('', {})
    assert cell.warnings[0].endswith('at tick 18446744073709551615: no such time in a bag; not recorded')


@pytest.mark.parametrize('tick', [(1 << 64) - 1, 1 << 63, 1 << 62], ids=hex)
@pytest.mark.parametrize('topic', ['d1/encoder', 'd3/command'])
def test_message_of_the_tick_without_a_time_is_not_recorded(cell, topic, tick):
    """A foreign one; numbers of ticks beyond all times ended the recorder when it wrote the bag."""
    cell.load(1)
    cell.tell('STARTED', 1, 0)
    other = {'encoder': {'index': 0, 'mode': 0, 'counts': 0, 'position': 0.0}}
    other['command'] = {'voltage': 0.0, 'error': 0.0, 'feedforward': 0.0}
    for index in range(SAMPLES):
        cell.tick(1, index, index)
        if index == 30:
            cell.say(topic, tick=tick, cycle=1, **other[topic.split('/')[1]])
    cell.recording.sort()
    cell.finish(1, SAMPLES)
    outcome = cell.outcome()
    assert (outcome.failure, outcome.lost) == ('', {})
    assert is_whole(outcome.path)
    assert cell.warnings == [f'/pkm/{topic}: 1 messages at no time of a bag; not recorded']


@pytest.mark.parametrize('time', [-1.0, math.nan, math.inf, -math.inf, 1e300, 1e10])
def test_laser_sample_without_a_time_is_not_recorded(cell, time):
    cell.load(1)
    cell.tell('STARTED', 1, 0)
    for index in range(SAMPLES):
        cell.tick(1, index, index)
        if index == 30:
            cell.say('laser', time=time, displacement=np.zeros(4))
    cell.recording.sort()
    cell.finish(1, SAMPLES)
    outcome = cell.outcome()
    assert (outcome.failure, outcome.lost) == ('', {})
    assert is_whole(outcome.path)
    assert cell.warnings == ['/pkm/laser: 1 messages at no time of a bag; not recorded']
