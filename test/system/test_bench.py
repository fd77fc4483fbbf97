"""`pkm bench`: one turn of the subjects that start quickly; the values are not checked."""

import json
import sys
from pathlib import Path

import pytest

DOMAIN = 131
PKM = Path(sys.prefix) / 'bin' / 'pkm'


@pytest.fixture(scope='module')
def bench(tmp_path_factory, module_processes):
    """Return output and figures of one turn."""
    file = tmp_path_factory.mktemp('bench') / 'new' / 'bench.json'
    only = [word for name in ('floor', 'composed', 'simulation') for word in ('--only', name)]
    done = module_processes.run(
        *(PKM, 'bench', '--turns', 1, '--cycles', 1, '--memory-cycles', 0, '--json', file), *only
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout, json.loads(file.read_text())


def test_one_run_measures_floor_cell_and_simulation(bench):
    _, figures = bench
    assert list(figures['subjects']) == ['floor', 'composed', 'simulation']
    for subject in figures['subjects'].values():
        assert subject['ticks_per_second'][0] > 0
        assert subject['cpu_us_per_tick'][0] > 0
    assert 0 < figures['subjects']['composed']['delivery_ms'][0][0] < 30_000


def test_ratio_is_computed_from_the_turns(bench):
    _, figures = bench
    composed, floor = (figures['subjects'][name]['ticks_per_second'][0] for name in ('composed', 'floor'))
    assert figures['ratios']['composed / floor']['ticks_per_second'] == pytest.approx(composed / floor)
    assert 'processes / naive' not in figures['ratios']


def test_every_target_is_reported_as_measured_or_not(bench):
    printed, figures = bench
    measured = {target['name']: target for target in figures['targets']}
    assert measured['composed cell / bare floor']['met'] in (True, False)
    for name in ('processes / naive executor', 'recorder and page cost'):
        assert measured[name]['met'] is None
    assert all(name in printed for name in measured)


def test_unknown_subject_is_refused(processes):
    done = processes.run(PKM, 'bench', '--only', 'rocket')
    assert done.returncode == 1
    assert "--only: ['rocket'] given; allowed: floor," in done.stderr
