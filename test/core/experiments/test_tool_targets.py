"""Targets at the tool: one specimen, calibrated and learned, and the rows of the table."""

import numpy as np
import pytest

from pkm_core.experiments.tool_targets import ENVIRONMENTS, LEARNING, ToolRun, tool_run, tool_target_rows

UM = 1e6


def test_learning_at_the_tool_halves_what_calibration_leaves():
    """Planar, specimen 1, y: 0.8 um by joint learning alone; x stays at the noise floor of friction."""
    errors = {target: tool_run('planar', 'nominal', 1, 3, target) for target in ('calibrated', 'tool')}
    mean = {target: UM * run.truth[LEARNING:].mean(axis=0) for target, run in errors.items()}
    assert mean['calibrated'][1] > 0.6
    assert mean['tool'][1] < 0.5 * mean['calibrated'][1]
    assert mean['tool'].max() < 0.9
    run = errors['tool']
    assert 0.5 < run.misfit < 1.5
    assert (run.varying <= run.truth[LEARNING:].max(axis=0)).all()
    # by laser: the error, and about one step of 0.91 um more
    assert (abs(UM * (run.laser - run.truth)).mean(axis=0) < 0.91).all()


def made(level, *, first=0.0):
    """Return a `ToolRun` with errors of `level` [um], and `first` more in cycle 6."""
    truth = np.full((LEARNING + 2, 2), level / UM)
    truth[5] += first / UM
    return ToolRun(('x', 'y'), 5, truth, truth + 0.4 / UM, np.full(2, 0.1 / UM), 1.0)


@pytest.mark.parametrize(
    ('level', 'first', 'met'), [(0.6, 0.0, [True, True]), (0.6, 0.6, [True, False]), (0.8, 0.0, [False, True])]
)
def test_rows_compare_the_truth_with_the_goals(level, first, met):
    found = {
        f'{target} {place}': [made(level, first=first)]
        for target in ('tool', 'calibrated')
        for place in ENVIRONMENTS['planar']
    }
    rows = tool_target_rows('planar', 'planar', found)
    nominal, transient, geometric, hard = (rows[i] for i in (0, 4, 5, 10))
    assert [nominal.met, transient.met] == met
    assert geometric.what == 'planar geometric, tool after calibration and learning'
    assert nominal.reached == f'x {level:.2f} ({level:.2f}), y {level:.2f} ({level:.2f}) um by the truth'
    assert nominal.goal == '<= 0.7 um in every coordinate'
    assert rows[1].reached.startswith(f'x {level + 0.4:.2f}')
    assert (hard.goal, hard.met) == ('x <= 2.2, y <= 1.2 um', True)
    assert ('below 1 from cycle 7' in transient.reached) == bool(first)
