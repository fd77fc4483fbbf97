"""The frame of the campaign of faults: order, counting, and the limits of its child processes."""

import os
import signal
from inspect import signature
from random import Random

import numpy as np
import pytest

from campaign import files, messages, processes, requests, soak, surroundings  # noqa: F401 (they register attacks)
from campaign.attacks import ATTACKS, Attack, FellShortError, NotPossibleError, campaign
from campaign.guarded import outcome_of
from campaign.world import World
from pkm_core.errors import PkmError


def run(function, tmp_path, trials=4, seed=1, name='one'):
    """Return the `Tally` of `function` as the only attack."""
    attacks = [Attack('kind', name, function, 1)]
    tallies = campaign(attacks, seed, 60.0, trials, lambda number: World(tmp_path / str(number)), lambda *_: None)
    return tallies[attacks[0]]


def test_same_seed_draws_the_same_trials(tmp_path):
    def drawn(seed):
        numbers = []
        run(lambda world, draw: numbers.append(draw.random()) or 'held', tmp_path / str(seed), seed=seed)
        return numbers

    assert drawn(1) == [Random(f'1 {number}').random() for number in (1, 2, 3, 4)]
    assert drawn(1) != drawn(2)


def test_fault_and_broken_attack_both_count_as_fell_short(tmp_path):
    def attack(world, draw):
        if world.folder.name == '2':
            raise FellShortError('seen')
        if world.folder.name == '3':
            raise KeyError('of the attack itself')
        return 'tried'

    tally = run(attack, tmp_path)
    assert tally.held == 2
    assert [(number, text.split(':')[0]) for number, text in tally.failures] == [(2, 'seen'), (3, 'KeyError')]


def test_impossible_attack_is_skipped_and_not_counted(tmp_path):
    def attack(world, draw):
        raise NotPossibleError('needs root')

    tally = run(attack, tmp_path)
    assert (tally.held, tally.failures, tally.skipped) == (0, [], 'not possible here: needs root')


def test_every_case_of_an_attack_comes_before_one_comes_again(tmp_path):
    seen = []
    attacks = [Attack('kind', 'one', lambda world, draw, case: seen.append(case) or 'held', 1, ('a', 'b', 'c'))]
    campaign(attacks, 1, 60.0, 6, lambda number: World(tmp_path / str(number)), lambda *_: None)
    assert sorted(seen[:3]) == sorted(seen[3:]) == ['a', 'b', 'c']


def test_every_attack_has_as_many_arguments_as_it_is_given():
    """A wrong attack would count as a fault of the cell; the campaign is too long to find out."""
    for each in ATTACKS:
        assert len(signature(each.run).parameters) == 2 + bool(each.cases), each.name


def test_folder_of_a_file_does_not_make_a_refusal_long(tmp_path):
    def refuse():
        raise PkmError(f'{tmp_path}: wrong\n' * (400 // len(': wrong\n')))

    assert outcome_of(refuse, tmp_path) == ''
    assert outcome_of(refuse).startswith('refusal of')


def test_process_that_outlives_a_trial_is_ended_by_its_mark(tmp_path):
    started = []

    def attack(world, draw):
        started.append(world.start('sleep', 600))
        assert any('sleep 600' in command for command in world.running().values())
        return 'started'

    run(attack, tmp_path, trials=1)
    assert started[0].wait(timeout=10.0) == -9


@pytest.mark.parametrize(
    ('raised', 'outcome'),
    [
        (PkmError('file: 3 given; allowed: 1'), ''),
        (PkmError('x' * 500), 'refusal of 500 characters'),
        (KeyError('joint'), 'KeyError at test_campaign.py'),
    ],
)
def test_short_refusal_holds_and_any_other_exception_does_not(raised, outcome):
    def function():
        raise raised

    found = outcome_of(function)
    assert found.startswith(outcome)
    assert bool(found) is bool(outcome)


def test_memory_of_a_reader_is_limited():
    assert 'MemoryError' in outcome_of(lambda: np.ones(3 << 27))  # 3 GiB


def test_reader_that_dies_by_a_signal_is_named():
    assert outcome_of(lambda: os.kill(os.getpid(), signal.SIGKILL)) == 'ended by signal 9'
