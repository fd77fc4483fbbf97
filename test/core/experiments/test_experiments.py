"""Experiments: results of a run, spread, tables with the thesis, and the same bits from every distribution of runs."""

import json
import math
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from multiprocessing import get_context

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from pkm_core.config import find_config
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.experiments import graph_driver
from pkm_core.experiments.condition import conditions, environments, prepared
from pkm_core.experiments.design_tables import size_table
from pkm_core.experiments.outcome import QUANTITIES, Outcome, spread, worst_axis
from pkm_core.experiments.report import markdown, study_report
from pkm_core.experiments.runs import farm, measure
from pkm_core.experiments.simulated import simulate
from pkm_core.experiments.study import run_study
from pkm_core.learning.coupling import design_feedforward
from pkm_core.machines import load_machine
from pkm_core.reporting.tables import Table
from pkm_core.simulation.cycles import run_cycles
from pkm_core.verbs.experiment import experiment


@cache
def condition(name, machine='planar', **changes):
    found = {each.name: each for each in conditions(machine)}[name]
    return replace(found, settled=1, **changes)


@cache
def measured(name, machine='planar', **changes):
    return measure(condition(name, machine, **changes), 1, 1)


def invented(wanted, seed):
    """Return an `Outcome` with every figure 1 um or 1 ms times the seed; with seed 2, d1 does not settle."""
    machine = load_machine(wanted.machine)

    def figures(axes):
        units = {name: 1e-3 if 'time' in name else 1e-6 for name in QUANTITIES}
        values = {name: np.full((wanted.settled + 2, len(axes)), seed * unit) for name, unit in units.items()}
        if seed == 2:
            values['settling_time_5um'][:, 0] = np.nan
        return values

    encoders, laser = figures(machine.joints), figures(machine.coordinates)
    return Outcome(wanted, seed, machine.joints, machine.coordinates, encoders, laser, 2.0 * seed, 3.0, (), ())


@cache
def invented_study(name):
    return run_study(name, 'simulation', lambda runs, cycles: [invented(*run) for run in runs], 2, 2)


def test_spread_is_mean_percentile_and_unsettled_share():
    values = np.array([*range(-1, -100, -1), -1000.0])
    found = spread(values, 2.0)
    assert found.mean == pytest.approx(2 * values.mean())
    assert found.p95 == 192.0  # the value of rank 0.95 x 99, rounded up
    assert found.never == 0.0
    found = spread(np.array([0.0, np.nan, 0.0, 0.0]))
    assert (found.mean, found.p95, found.never) == (math.inf, math.inf, 0.25)


def test_records_hold_the_arrays_of_the_simulation():
    """The laser's times count from the start of each cycle."""
    records, _ = simulate(condition('robust'), 1, 2)
    machine, _, _, joints, gains, _, _ = prepared(condition('robust'))
    ran = run_cycles(machine, joints, gains, None, 2, 1, laser=True)
    for cycle, record in enumerate(records):
        np.testing.assert_array_equal(record.error, ran.error[cycle])
        np.testing.assert_array_equal(record.laser, ran.laser[cycle].displacement)
        assert record.is_whole
        assert record.ticks[0] == cycle * len(joints)
        np.testing.assert_allclose(record.laser_time, 0.8e-3 * np.arange(450), rtol=0.0, atol=1e-12)  # of 360 ms
    assert [each.max_dynamic_error for each in records[1].metrics()] == [
        each.max_dynamic_error for each in ran.metrics[1]
    ]


def test_laser_does_not_change_the_run():
    machine, _, _, joints, gains, _, _ = prepared(condition('robust'))
    with_laser, without = (run_cycles(machine, joints, gains, None, 1, 1, laser=laser) for laser in (True, False))
    np.testing.assert_array_equal(with_laser.counts, without.counts)
    assert without.laser == ()


def test_laser_measures_the_effect_of_link_errors():
    """The encoders do not see it."""
    off, exact = (measured('best law', environment=environment) for environment in ('nominal', 'exact'))
    resting = {name: np.abs(each.laser['steady_state_error'][-1, 0]) for name, each in (('off', off), ('exact', exact))}
    assert resting['off'] > 5e-6  # link errors of 10 um, over a move of 10 mm
    assert resting['exact'] < 0.91e-6
    assert np.abs(off.encoders['steady_state_error'][-1]).max() < 1e-6


def test_coupling_feedforward_reduces_the_error_of_four_axes():
    alone, coupled = (worst_axis([measured(name, 'four_dof')])[0, -1] for name in ('robust', 'coupled'))
    assert coupled < 0.7 * alone


def test_coupling_feedforward_of_uncoupled_axes_is_zero():
    machine, _, _, joints, gains, _, _ = prepared(condition('XY stage'))
    assert np.abs(design_feedforward(machine, gains, joints)).max() < 1e-9


def test_processes_do_not_change_an_outcome():
    tasks = [(measure, condition('coupled'), seed, 1) for seed in (1, 2)]
    done = []
    with ThreadPoolExecutor(1) as here, ProcessPoolExecutor(1, mp_context=get_context('spawn')) as there:
        for one, other in zip(farm(here, tasks), farm(there, tasks, done.append), strict=True):
            assert one.seed == other.seed
            for source in ('encoders', 'laser'):
                for quantity in QUANTITIES:
                    np.testing.assert_array_equal(getattr(one, source)[quantity], getattr(other, source)[quantity])
    assert done == [1, 2]


def test_error_of_a_run_is_raised_by_farm():
    wrong = replace(condition('robust'), environment='moon')
    with ThreadPoolExecutor(1) as executor, pytest.raises(PkmError, match="environment 'moon' is unknown"):
        farm(executor, [(measure, wrong, 1, 1), (measure, condition('robust'), 1, 1)])


@pytest.mark.parametrize('name', ['planar', 'four_dof'])
def test_every_condition_of_an_experiment_can_be_prepared(name):
    for each in conditions(name):
        machine, _, _, joints, gains, law, start = prepared(each)
        assert tuple(gains) == machine.joints == joints.coordinates
        assert (law is None) is (each.law == 'none')
        assert (start is None) is (not each.coupled)
    assert find_config('control', f'{name}_thesis').is_file()


def test_tables_have_the_spread_and_the_thesis_value():
    tables, figures = study_report(invented_study('four_dof'))
    assert [table.title.split(',')[0] for table in tables] == ['Table 8.2', 'Table 8.3']
    rows = {(row['quantity'], row['axis'], row['control']): row for row in figures['joints']}
    row = rows['max_dynamic_error_um', 'd7', 'robust']
    assert row['thesis'] == 47.0
    assert row['nominal'] == pytest.approx({'mean': 1.5, 'p95': 2.0, 'never': 0.0})
    assert rows['settling_5um_ms', 'd1', 'best law']['hard']['never'] == 0.5
    assert rows['steady_state_error_um', 'd5', 'thesis law']['thesis'] == 'lost'
    assert rows['max_dynamic_error_um', 'worst', 'coupled']['thesis'] is None
    stages = {row['axis'] for row in figures['end_point_by_laser'] if row['control'] == 'XY stage'}
    assert stages == {'x', 'y'}  # those of z and phi are in `pkm experiment stage`
    settling = next(row for row in tables[0].rows if row[0] == 'settling to 5 um [ms]')
    assert settling[1:] == ['d1', 'computed torque', '30.0', '50 % never', '50 % never', '50 % never']
    assert tables[0].headings[-3:] == ['nominal', 'hard', 'elastic']
    assert tables[1].headings[-4:] == list(environments('four_dof'))
    stage = [row for row in tables[1].rows if row[2] == 'XY stage']
    assert stage
    assert all(row[-1] == '' and row[-2] for row in stage)  # the stage has no environment elastic
    assert figures['worst_axis_um_by_cycle']['robust']['hard'].shape == (2, 5)
    json.dumps(figures['joints'])


def test_planar_experiment_has_tables_7_4_and_7_5():
    tables, _ = study_report(invented_study('planar'))
    effort = {row[0]: row[1:] for row in tables[2].rows}
    # 11.05 N/V over 11.44 m/s^2/V; 4 V at 1.25 A/V and at 5 A/V
    assert effort['moving mass, X axis or d1 [kg]'] == ['8.2', '8.20', '0.97', '0.97']
    assert effort['peak current [A]'] == ['12', '20.0', 'lost', '5.0']
    assert size_table().rows[2] == ['workspace [mm]', '40 x 40', '40.0 x 40.0', '40 x 21', '40.0 x 20.3']


def test_table_as_markdown():
    text = markdown(Table('A title', ['', 'b'], [['1', '2']]))
    assert text.splitlines() == ['**A title**', '', '|  | b |', '|---|---|', '| 1 | 2 |']


def run_verb(*options):
    app = typer.Typer()
    app.command()(experiment)
    return CliRunner().invoke(app, [str(option) for option in options])


@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        (['targets', '--arrangement', 'composed'], 'composed given; targets runs in simulation only'),
        (['planar', '--out', '/proc/nowhere'], '/proc/nowhere: cannot be written'),
    ],
)
def test_invalid_option_is_refused(options, complaint):
    result = run_verb(*options)
    assert isinstance(result.exception, PkmError)
    assert complaint in str(result.exception)


def test_graph_is_refused_without_pkm_nodes(monkeypatch):
    monkeypatch.setattr(graph_driver, 'entry_points', lambda group: [])
    with pytest.raises(PkmError, match='no installed package drives the ROS 2 graph'):
        graph_driver.graph_driver()


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(('name', 'first', 'last'), [('planar', '7_15', '7_29'), ('four_dof', '8_16', '8_42')])
def test_verb_writes_every_figure_and_table(name, first, last, tmp_path):
    result = run_verb(name, '--seeds', 1, '--cycles', 2, '--out', tmp_path, '--json', tmp_path / 'figures.json')
    assert result.exit_code == 0, result.output
    drawn = sorted(path.stem.removeprefix('fig_') for path in tmp_path.glob('fig_*.png'))
    assert (drawn[0], drawn[-1]) == (first, last)
    chapter, numbers = drawn[0].split('_')[0], [int(each.split('_')[1]) for each in drawn]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    figures = json.loads((tmp_path / 'figures.json').read_text())
    assert figures['seeds'] == 1
    assert {row['control'] for row in figures['joints']} == {
        each.name for each in conditions(name) if each.machine == name
    }
    assert f'Table {chapter}.2' in (tmp_path / 'tables.md').read_text()


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_every_target_is_met(tmp_path):
    result = run_verb('targets', '--seeds', 2, '--json', tmp_path / 'targets.json')
    assert result.exit_code == 0, result.output
    rows = json.loads((tmp_path / 'targets.json').read_text())['targets']
    missed = [row['what'] for row in rows if row['met'] is False]
    # (7.24) ignores the other axes, and the coupling of the design does not correct the gain error of d3
    # in the hard environment the friction changes by 10 % from cycle to cycle; elastic: three updates of gain 0.3 leave
    # a third of the 2.6 um that the calibration leaves, and phi on its mode of 335 Hz does not repeat
    at_tool = {
        '4-DOF elastic, tool after calibration and learning',
        '4-DOF hard, tool after calibration and learning',
        '... elastic, worst coordinate of every cycle from 4 to 10',
    }
    assert set(missed) <= {'4-DOF robust, (7.24)', "planar robust, with the design's coupling"} | at_tool


def test_experiments_use_the_configured_gains():
    machine = load_machine('planar')
    assert prepared(condition('robust')).gains == load_control(machine)
