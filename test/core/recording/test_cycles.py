"""The life of a cycle: its bag, its metadata, and the outcome that is reported."""

import json
from hashlib import sha256
from time import sleep

import numpy as np
import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import column, read_metadata, read_topics
from pkm_core.bag.repair import lost_messages
from pkm_core.recording import cycles
from support.recorded_cell import JOINTS, SAMPLES, TS, Cell, no_file_beyond


def test_metadata_name_content_and_end(cell):
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


def test_feedforward_of_zeros_has_no_digest(cell):
    cell.play(1, 0)
    learned = json.loads(read_metadata(cell.outcome().path)['custom_data']['learned_feedforward'])
    assert learned == {f'/pkm/{joint}/command': '' for joint in JOINTS}


def test_optional_topics_without_publisher_are_not_expected(cell):
    silent = {'/pkm/laser', '/pkm/d3/cycle_metrics'}
    cell.offered -= silent
    say = cell.say
    cell.say = lambda topic, **fields: f'/pkm/{topic}' in silent or say(topic, **fields)
    cell.play(1, 0)
    outcome = cell.outcome()  # available at once: no wait for late messages
    assert outcome.lost == {}
    expected = json.loads(read_metadata(outcome.path)['custom_data']['expected'])
    assert not silent & expected.keys()
    assert expected['/pkm/d1/cycle_metrics'] == 1


@pytest.mark.usefixtures('impatient')
def test_missing_messages_are_reported_by_tick(cell):
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


def test_more_messages_than_expected_are_reported(cell):
    """A second state estimator, or any other further publisher, is as much a fault as a lost message."""
    cell.load(1)
    cell.run(1, 0)
    cell.states(0)
    cell.finish(1, SAMPLES)
    outcome = cell.outcome()
    assert (outcome.lost, outcome.surplus) == ({}, {'/pkm/pose': 1, '/pkm/joint_states': 1})
    assert json.loads(read_metadata(outcome.path)['custom_data']['surplus']) == outcome.surplus


def test_forged_events_of_many_cycles_keep_no_memory(cell):
    for number in range(1000, 1200):
        cell.tell('LOADED', number)
    assert len(list(cell.recording._cycles)) <= 20
    cell.play(1, 0)
    assert cell.outcome().lost == {}


def test_slow_messages_after_the_end_are_waited_for(cell, monkeypatch):
    """A slow recorder takes longer for its queues than the wait for one message."""
    monkeypatch.setattr(cycles, 'STRAGGLERS', 0.2)
    late = range(SAMPLES - 8, SAMPLES)
    cell.play(1, 0, without={index: ['d7/command'] for index in late})
    for tick in late:
        sleep(0.06)
        cell.recording.close_late()
        cell.say('d7/command', tick=tick, cycle=1, voltage=1.0, error=0.0, feedforward=0.0)
        cell.recording.sort()
    assert cell.outcome().lost == {}


def test_safe_stop_loses_no_commands_and_has_a_reason(cell):
    cell.load(1)
    cell.run(1, 0, end=10)
    for tick in range(10, 30):
        cell.tick(1, tick, 10, without=[f'{joint}/command' for joint in JOINTS])
    cell.tell('FAULT', 1, 30, samples=10, message='no answer from d3')
    outcome = cell.outcome()
    assert outcome.lost == {}
    assert read_metadata(outcome.path)['custom_data']['end'] == 'fault: no answer from d3'
    assert cell.recording.progress == 29, 'or the machine would wait for commands that never come'


def test_recorder_stop_closes_the_bag_as_interrupted(cell):
    cell.load(1)
    cell.run(1, 0, end=10)
    cell.recording.close_all()
    outcome = cell.outcome()
    assert outcome.lost == outcome.surplus == {}
    assert read_metadata(outcome.path)['custom_data']['end'].startswith('interrupted: the recorder ended')
    assert len(read_cycle(outcome.path).ticks) == 10


def test_bag_of_a_killed_machine_names_what_it_lacks(cell):
    """It was killed within tick 21; the states of tick 20 and a command of tick 7 have not arrived."""
    cell.load(1)
    cell.states = lambda tick: Cell.states(cell, tick) if tick != 20 else None
    cell.run(1, 0, without={7: ['d3/command'], 21: ['d7/encoder', *(f'{joint}/command' for joint in JOINTS)]}, end=22)
    cell.recording.close_all()
    outcome = cell.outcome()
    assert outcome.lost == {'/pkm/d3/command': 1, '/pkm/d7/encoder': 1, '/pkm/pose': 1, '/pkm/joint_states': 1}
    assert outcome.lost_ticks == {'/pkm/d3/command': [[7, 7]], '/pkm/d7/encoder': [[21, 21]]}
    assert outcome.surplus == {}
    assert lost_messages(outcome.path) == lost_messages(next(outcome.path.glob('*.mcap'))) == outcome.lost


def test_next_start_closes_a_cycle_without_an_end(cell):
    cell.load(1)
    cell.run(1, 0, end=10)
    cell.load(2)
    cell.run(2, 0)
    outcome = cell.outcome()
    assert outcome.cycle == 1
    assert 'cycle 2 started' in read_metadata(outcome.path)['custom_data']['end']
    cell.finish(2, SAMPLES)
    assert read_cycle(cell.outcome().path).is_whole


def test_write_error_is_reported_once_for_its_cycle(cell):
    rng = np.random.default_rng(1)
    noise = lambda index: rng.standard_normal()  # noqa: E731 - the chunks must not shrink to nothing
    cell.load(1)
    with no_file_beyond(4000):
        for start in range(0, 600, SAMPLES):
            cell.run(1, start, feedforward=noise)
        outcome = cell.outcome()
        assert outcome.failure.startswith(f'{outcome.path}: File too large; ')
        assert outcome.failure.endswith(f'before with: pkm bag-doctor {outcome.path}')
        cell.finish(1, 600)
    assert cell.recording.outcomes == []
    cell.play(2, 600)
    assert read_cycle(cell.outcome().path).is_whole


def test_error_on_closing_is_reported(cell):
    cell.load(1)
    cell.run(1, 0)
    with no_file_beyond(1):
        cell.finish(1, SAMPLES)
    assert 'File too large' in cell.outcome().failure


def test_missing_folder_is_reported(tmp_path):
    folder = tmp_path / 'bags'
    folder.touch()
    cell = Cell(folder)
    cell.play(1, 0)
    assert cell.outcome().failure == f'{folder}: Not a directory'
