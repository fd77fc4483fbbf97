"""Measurements of a cycle, gathered in any order until learning at the tool can use them."""

import numpy as np
import pytest

from pkm_core.errors import LearningError
from pkm_core.learning.tool_cycles import ToolCycles
from pkm_core.machines import load_machine

PARTS = ['error d1', 'error d3', 'reference', 'end', 'laser']


def give(cycles, part, *, tick=200, samples=80, d3=80):
    """Give a part of cycle 2, which ends before `tick`: 40 ms, 50 samples of the laser from 60.0 ms on."""
    if part.startswith('error'):
        joint = part.split()[1]
        cycles.error(2, joint, np.full(d3 if joint == 'd3' else samples, 1e-6))
    elif part == 'reference':
        cycles.reference(2, np.zeros((samples, 2)))
    elif part == 'end':
        cycles.finished(2, tick, samples)
    else:
        for number in range(70, 125):
            cycles.sample((number * 0.8e-3, 1e-6, 2e-6))


@pytest.mark.parametrize('turn', range(len(PARTS)))
def test_cycle_is_complete_whatever_comes_last(turn):
    cycles, order = ToolCycles(load_machine('planar')), PARTS[turn:] + PARTS[:turn]
    for part in order:
        assert cycles.missing(2)
        give(cycles, part)
    assert cycles.missing(2) == []
    error, first, time, displacement = cycles.take(2)
    assert (error.shape, first) == ((80, 2), 120)
    assert time == pytest.approx(np.arange(75, 125) * 0.8e-3)  # from 60 ms up to, not at, 100 ms
    assert displacement.shape == (50, 2)


def test_missing_parts_are_named():
    cycles = ToolCycles(load_machine('planar'))
    give(cycles, 'error d1')
    assert cycles.missing(2) == ['the errors of d3', 'the joint_trajectory', 'its end']
    give(cycles, 'end')
    assert cycles.missing(2) == ['the errors of d3', 'the joint_trajectory', 'samples of the laser']
    assert cycles.missing(2, laser=False) == ['the errors of d3', 'the joint_trajectory']


def test_cycle_without_laser_samples_is_taken_without_any():
    cycles = ToolCycles(load_machine('planar'))
    for part in PARTS[:-1]:
        give(cycles, part)
    _, _, time, displacement = cycles.take(2)
    assert time.size == displacement.size == 0


def test_joints_with_different_numbers_of_errors_are_refused():
    cycles = ToolCycles(load_machine('planar'))
    for part in PARTS:
        give(cycles, part, d3=79)
    with pytest.raises(
        LearningError, match=r"encoder errors of cycle 2: \{'d1': 80, 'd3': 79\} values; expected equal"
    ):
        cycles.take(2)


def test_only_the_last_cycles_are_kept():
    """A sender that counts on for ever does not fill the memory; the latest cycle is known."""
    cycles = ToolCycles(load_machine('planar'))
    give(cycles, 'error d1')
    for number in range(3, 8):
        cycles.finished(number, 100 * number, 80)
    assert 'the errors of d1' in cycles.missing(2)
    assert 'its end' not in cycles.missing(7)
