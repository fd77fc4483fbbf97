"""The hour of the drift experiment on one planar machine, its window and tables, and its figure."""

from functools import cache

import numpy as np
import pytest

from pkm_core.experiments.drift import (
    EVERY,
    MACHINES,
    MINUTES,
    RECALIBRATED,
    RUNS,
    TIMES,
    DriftRun,
    Recalibrated,
    drift_run,
    drift_tasks,
    per_kelvin,
    window,
)
from pkm_core.experiments.drift_figure import draw_drift
from pkm_core.experiments.drift_report import drift_report
from pkm_core.machines import load_machine

UM = 1e6


@cache
def hour(run):
    return drift_run('planar', run, 1)


def test_home_drifts_by_the_temperatures_and_the_laser_sees_it():
    """Links and platform of the planar machine move P along y by their expansion; home itself is held by encoders."""
    found = hour('fixed')
    nodes = list(found.nodes)
    links = found.temperatures[:, [nodes.index('link d1'), nodes.index('link d3')]].mean(axis=1)
    # (4.9): dy/dl = l / 2Y for both links, Y at home; the offset dy expands with the platform
    geometry = load_machine('planar').config.geometry
    height = np.sqrt(geometry.l2**2 - 0.03**2)
    expected = 23.1e-6 * (
        links * geometry.l2**2 / height + geometry.dy * found.temperatures[:, nodes.index('platform')]
    )
    drift = UM * (found.home[:, 1] - expected)
    assert np.ptp(drift) < 1.0  # the scales, 0.6 K apart from the marks, and friction at rest
    assert UM * found.home[-1, 1] > 8.0
    assert UM * np.abs(found.laser - found.home)[-20:].mean() < 0.2
    assert found.error.shape == found.home.shape == (len(TIMES), 2)


@pytest.mark.slow
def test_learning_keeps_the_error_of_the_move_that_heat_doubles():
    """The force constant falls by 1 %; a fixed feedforward is then wrong by as much."""
    first, last = window(0, 10), window(60, 10)
    fixed, tool = (UM * hour(run).error.max(axis=1) for run in ('fixed', 'tool'))
    assert fixed[last].mean() > 2.0 * fixed[first].mean()
    assert tool[last].mean() < 1.3 * tool[first].mean()
    assert tool[last].mean() < 2.5


@pytest.mark.parametrize('name', list(MACHINES))
def test_plant_expands_as_the_budget_predicts(name):
    plant, budget = per_kelvin(name)
    np.testing.assert_allclose(np.abs(plant), budget, rtol=3e-3, atol=5e-9)


def test_counted_cycles_begin_at_the_minute_and_stay_in_the_hour():
    assert window(0, 10) == slice(0, 10)
    assert window(15, 10) == slice(45, 55)
    assert TIMES[window(15, 10).start] == 15 * 60.0
    assert window(60, 10) == slice(len(TIMES) - 10, len(TIMES))
    assert window(30, 10_000) == slice(0, len(TIMES))
    assert TIMES[-1] == 3600.0
    assert TIMES[1] == EVERY


def test_every_run_of_every_specimen_is_a_task():
    keys = list(drift_tasks(2, 10))
    assert len(keys) == len(set(keys)) == 2 * len(MACHINES) * (len(RUNS) + 1)
    assert ('planar', RECALIBRATED, 2) in keys


def made(machine, level):
    """Return a `DriftRun` in which everything is `level` [um], [K]."""
    m, n = (2, 7) if machine == 'planar' else (4, 13)
    joints = load_machine(machine).joints
    nodes = (*(f'{kind} {joint}' for kind in ('motor', 'link', 'scale') for joint in joints), 'platform')
    rows = np.full((len(TIMES), m), level / UM)
    return DriftRun(nodes, np.full((len(TIMES), n), level), rows, rows + 0.25 / UM, rows)


def test_tables_and_figure_have_the_figures_of_the_runs(tmp_path):
    found: dict = {}
    for machine in MACHINES:
        m = len(load_machine(machine).coordinates)
        found |= {(machine, run, 1): made(machine, 1.0 + i) for i, run in enumerate(RUNS)}
        at_rest = np.full((len(MINUTES), m), 0.5 / UM)
        again = np.full((len(MINUTES), 4, m), 4.0 / UM)
        found[machine, RECALIBRATED, 1] = Recalibrated(again, 0.1 * at_rest, at_rest)
    tables, figures = drift_report(found, 1, 10)
    shift, home, errors, rest, *_ = tables
    assert [row[:2] for row in shift.rows][:2] == [['4-DOF', 'plant'], ['4-DOF', 'pkm budget']]
    assert shift.rows[0][4] == shift.rows[1][4] == '3.31'
    assert home.rows[0] == ['0', *['1.0'] * 8, '0.25 (0.25)']
    assert errors.rows[-1] == ['60', '1.00 (1.00)', '2.00 (2.00)', '4.00 (4.00)', '3.00 (3.00)']
    assert rest.rows[0] == ['0', *['0.50', '0.05'] * 4]
    assert figures['planar'][2]['minute'] == 15
    assert figures['planar'][2]['error_um']['tool'] == {'mean': pytest.approx(3.0), 'p95': pytest.approx(3.0)}
    draw_drift(tmp_path, found)
    assert (tmp_path / 'drift.png').stat().st_size > 20_000
