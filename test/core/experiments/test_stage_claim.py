"""The claim against the XY stage: assumptions reach truth and model, the search is that of `pkm tune`."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.experiments import stage_assumptions
from pkm_core.experiments.outcome import spread
from pkm_core.experiments.stage_assumptions import SHIPPED, scaled, stage, tuned, tuning_rules
from pkm_core.experiments.stage_claim import (
    FRICTIONS,
    MODES,
    ROWS,
    SINGLE,
    Claim,
    claim_tasks,
    highest_mode,
    holds,
    loops,
    stage_settling,
)
from pkm_core.experiments.stage_report import draw_stage, stage_report
from pkm_core.machines import load_machine
from pkm_core.plant.truth import load_truth
from pkm_core.tuning.config import load_tuning

STAGE = load_machine('xy_stage')


@cache
def shipped_gains():
    """Gains of the shipped x axis in the form of `tuned`."""
    return scaled(load_control(STAGE)['x'].model_dump(), load_model(STAGE)['x'].gain)


def test_shipped_assumptions_give_the_shipped_stage():
    with stage(SHIPPED, shipped_gains()) as given:
        assert given.machine.config == STAGE.config
        assert load_model(given.machine) == load_model(STAGE)
        assert load_truth(given.machine, 'exact') == load_truth(STAGE, 'exact')
        assert given.gains['x'].kp == pytest.approx(load_control(STAGE)['x'].kp)


def test_assumptions_change_truth_and_model_alike():
    changed = replace(SHIPPED, friction=8.0, mode=110.0, damping=2.0, masses=(4.1, 1.5), move=(5e-3, 2e-3))
    with stage(changed, shipped_gains()) as given:
        truth, levels = load_truth(given.machine, 'exact')
        model = load_model(given.machine)
        before = load_truth(STAGE, 'exact')[0]
        assert levels.coulomb_friction == 8.0
        assert truth.friction.stiffness == pytest.approx(4 * before.friction.stiffness)
        for joint, axis in truth.axes.items():
            assert axis.modes[0].resonance == pytest.approx(0.5 * before.axes[joint].modes[0].resonance)
            assert model[joint].modes[0].resonance_damping == pytest.approx(0.06)
            assert model[joint].gain == pytest.approx(2 * load_model(STAGE)[joint].gain)
        assert given.machine.config.masses.mx == pytest.approx(4.1)
        np.testing.assert_allclose(np.ptp(given.poses.position, axis=0), [5e-3, 2e-3])


def test_rules_of_the_shipped_mode_are_those_of_tune():
    assert tuning_rules(SHIPPED.loop) == load_tuning()
    low = tuning_rules(replace(SHIPPED, mode=110.0).loop)
    assert low.targets.bandwidth == pytest.approx(0.5 * load_tuning().targets.bandwidth)
    assert low.limits.nominal == load_tuning().limits.nominal
    assert low.search == load_tuning().search


def test_search_finds_the_shipped_gains_and_repeats(monkeypatch):
    """With the budget of config/tuning the first loop is the shipped x axis; here with a tenth of it, twice."""
    short = load_tuning().search.model_copy(update={'generations': 20, 'restarts': 1})
    rules = tuning_rules(SHIPPED.loop).model_copy(update={'search': short})
    monkeypatch.setattr(stage_assumptions, 'tuning_rules', lambda loop: rules)
    done = []
    with ThreadPoolExecutor(1) as executor:
        gains = tuned(SHIPPED.loop, executor, done.append)
        assert gains == tuned(SHIPPED.loop, executor)
    assert done[-1] == 20
    assert gains['kp'] == pytest.approx(shipped_gains()['kp'], rel=0.3)


def test_stage_with_a_lower_mode_or_friction_settles_later():
    gains = shipped_gains()
    times = stage_settling(SHIPPED, gains, 1, 1)
    rough = stage_settling(replace(SHIPPED, friction=8.0), gains, 1, 1)
    assert times.shape == (1, 2)
    assert rough[0, 1] > times[0, 1] + 2e-3  # 11.5 and 5.6 ms
    np.testing.assert_array_equal(times, stage_settling(SHIPPED, gains, 1, 1))


def invented_claim():
    """The planar machine at 10 and 0 ms; the stage at 2200 Hz ms over its mode, one ms per newton, never at 32 N."""
    planar = spread(np.array([10.0])), spread(np.array([0.0]))

    def pair(friction, mode):
        time = np.nan if friction == 32.0 else 2200.0 / mode - 10.0 + friction
        return spread(np.array([time])), spread(np.array([time]))

    return Claim(
        {name: pair(each.friction, each.mode) for name, each in ROWS.items()},
        {(friction, mode): pair(friction, mode) for friction in FRICTIONS for mode in MODES},
        {name: pair(each.friction, each.mode) for name, each in SINGLE.items()},
        planar,
        planar,
        dict.fromkeys(('x', 'y', 'z', 'phi'), planar[0]),
    )


def test_claim_holds_where_the_stage_is_later():
    found = invented_claim()
    assert holds(found, found.cells[0.0, 220.0]) == (False, False)  # 0 ms
    assert holds(found, found.cells[2.0, 220.0]) == (False, True)  # 2 ms
    assert holds(found, found.cells[2.0, 110.0]) == (True, True)  # 12 ms
    assert holds(found, found.cells[32.0, 220.0]) == (True, True)  # never
    assert highest_mode(found, 2.0, 0) == 120.0
    assert np.isnan(highest_mode(replace_cells(found), 0.0, 0))


def replace_cells(found):
    """The same with a stage that settles at once everywhere."""
    return replace(found, cells=dict.fromkeys(found.cells, found.planar[1:] * 2))


def test_report_and_figure_show_the_map(tmp_path):
    found = invented_claim()
    tables, data = stage_report(found, 1, 1)
    assumptions, shown, limits, single = tables
    assert ['thesis, XY stage', '28.0', '22.0', ''] in assumptions.rows
    assert assumptions.rows[4][-1] == 'y'
    assert shown.rows[2][3] == '12 / 12 *'
    assert shown.rows[-1][-1] == '- / - *'
    assert limits.rows[2] == ['2 N', '120 Hz', '220 Hz']
    assert [row[0] for row in single.rows] == ['x', 'y', 'z', 'phi']
    assert data['map_ms']['2 N, 110 Hz'][0]['mean_ms'] == pytest.approx(12.0)
    draw_stage(tmp_path, found)
    assert (tmp_path / 'stage_claim.png').stat().st_size > 20_000


def test_tasks_cover_every_assumption_and_their_loops():
    gains = dict.fromkeys(loops(), shipped_gains())
    tasks = claim_tasks(gains, 2, 3)
    assert loops()[0] == SHIPPED.loop
    assert {key[:2] for key in tasks} >= {('row', name) for name in ROWS} | {('cell', (2.0, 110.0))}
    assert sum(key[0] == 'cell' for key in tasks) == len(FRICTIONS) * len(MODES)
    assert sum(key[0] == 'planar' for key in tasks) == 4
