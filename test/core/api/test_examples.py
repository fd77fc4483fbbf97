"""The programs under docs/examples run as a reader runs them, and print and draw what they announce."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import nbclient
import nbformat
import pytest

import pkm_core as pkm

EXAMPLES = Path(__file__).resolve().parents[3] / 'docs' / 'examples'
SCRIPTS = sorted(EXAMPLES.glob('[0-9]*.py'))
NOTEBOOK = EXAMPLES / '01_first_motion.ipynb'
# by number of the example: what it prints (a pattern), how often, and what it draws
PROMISES = {
    '01': (r'd\d: \d+\.\d um in cycle 1, 0\.\d um in cycle 12', 4, ['motion.png', 'simulation.png']),
    '02': (r'inverse  cycles 8 to 12, seeds \(1, 2, 3\): 0\.\d+ um', 1, ['laws.png']),
    '03': (r'Pd +d\d: +\d+\.\d um in motion, +-\d+\.\d+ um at rest', 4, ['cycle.png']),
    '04': (r'Ahead, cycle +\d+:( \d+\.\d){4}', 5, ['own_law.png']),
    '05': (r'(believed|identified) +LoopMargins\(x: gain \d+\.\d dB', 2, ['cycle.png']),
    '06': (
        r'd\d: K = \d\.\d+ \+- 0\.\d+ m/s\^2/V \(config/model',
        4,
        [f'moves_{j}.png' for j in ('d1', 'd3', 'd5', 'd7')],
    ),
    '07': (r'(config/model|fitted) +0\.\d+ dB, 0\.\d+ deg from the measured response', 2, ['bode.png']),
    '08': (r'd\d error \[um\] +\d+\.\d+ +\d+\.\d+', 8, ['cycle.csv', 'cycle.png']),
}
READ_BAGS = ('06', '08')


@pytest.fixture(scope='module')
def run_folder(tmp_path_factory, start_recording_in):
    """Return a folder with the bags of three learning cycles, as a run of the cell leaves it."""
    folder = tmp_path_factory.mktemp('run')
    machine = pkm.load_machine('four_dof')
    result = pkm.simulate(machine, 'four_dof_70ms', cycles=3, law='fourier_pid')
    for number in range(1, 4):
        cycle = result.cycle(number)
        signals = {'error': cycle.error, 'voltage': cycle.voltage}
        driven = SimpleNamespace(machine=machine, poses=result.motion.poses, joints=result.motion.joints, **signals)
        recording = start_recording_in(folder / 'bags', driven, number, motion='four_dof_70ms')
        recording.ticks()
        recording.close()
    return folder


def run(script, *arguments, folder):
    command = [sys.executable, str(script), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, env={**os.environ})


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda path: path.stem)
def test_example_prints_and_draws_what_it_says(script, request, tmp_path):
    number = script.name[:2]
    pattern, times, files = PROMISES[number]
    bags = [request.getfixturevalue('run_folder')] if number in READ_BAGS else []
    done = run(script, *bags, tmp_path, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(re.findall(pattern, done.stdout)) == times, done.stdout
    assert all((tmp_path / file).stat().st_size > 10_000 for file in files)


@pytest.mark.parametrize('number', READ_BAGS)
def test_example_without_bags_names_the_recording_command(number, tmp_path):
    (script,) = EXAMPLES.glob(f'{number}_*.py')
    done = run(script, folder=tmp_path)
    assert done.returncode == 1
    assert done.stderr == 'runs/first: no bags; record some with: bringup_scripts/run --out runs/first\n'


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda path: path.stem)
def test_example_is_short_and_says_what_it_shows(script):
    text = script.read_text(encoding='utf-8')
    assert 20 <= len(text.splitlines()) <= 40
    assert 'Prints' in text.partition('import')[0]
    assert f'({script.name})' in (EXAMPLES / 'README.md').read_text(encoding='utf-8')


def test_notebook_is_made_from_its_script():
    """Renew it with: python docs/examples/make_notebook.py > docs/examples/01_first_motion.ipynb."""
    made = runpy.run_path(str(EXAMPLES / 'make_notebook.py'))
    assert NOTEBOOK.read_text(encoding='utf-8') == made['notebook'](made['SCRIPT'])


def test_notebook_runs_and_shows_its_figures(tmp_path):
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=240, resources={'metadata': {'path': str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == 'code' for output in cell.outputs]
    assert sum('image/png' in output.get('data', {}) for output in outputs) == 2
    printed = ''.join(output.get('text', '') for output in outputs)
    result = pkm.simulate(pkm.load_machine('four_dof'), 'four_dof_70ms', cycles=12, law='fourier_pid', seed=1)
    expected = [f'{1e6 * each:.1f} um in cycle 12' for each in result.max_dynamic_error[-1]]
    assert re.findall(r'[\d.]+ um in cycle 12', printed) == expected
