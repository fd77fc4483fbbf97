"""The command `pkm` itself: it lists verbs without importing them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = ('numpy', 'scipy', 'numba', 'pydantic', 'pint', 'matplotlib', 'rclpy')
REPORTER = f"""
import sys
from pathlib import Path
from pkm_core.cli import main
try:
    main()
finally:
    print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
"""


def run(script, *arguments):
    """Run a Python `script` in a terminal of 200 columns."""
    return subprocess.run(
        [sys.executable, '-c', script, *arguments],
        env=os.environ | {'COLUMNS': '200'},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


def pkm(*arguments):
    """Run `pkm` with `arguments`; the last line on stderr is the list of heavy packages that it has imported."""
    return run(REPORTER, *arguments)


@pytest.mark.parametrize('arguments', [['--help'], ['--version'], []])
def test_listing_of_the_verbs_imports_no_heavy_package(arguments):
    done = pkm(*arguments)
    assert done.stderr.splitlines()[-1] == '[]'


def test_help_describes_every_verb_by_its_docstring():
    text = ' '.join(pkm('--help').stdout.replace('│', ' ').split())
    for verb, description in {
        'bag-doctor': 'Repair a bag that its recorder did not close',
        'run': 'Run a motion',
        'tune': 'Tune every axis of a machine by a genetic algorithm',
    }.items():
        assert f' {verb} {description}' in text


def test_misspelt_verb_is_answered_with_the_nearest_one():
    done = pkm('identfy-bag')
    assert done.returncode == 2
    assert "Did you mean 'identify-bag'" in ' '.join(done.stderr.replace('│', ' ').split())


def test_completion_offers_verbs_options_and_configured_names(monkeypatch):
    def offered(typed):
        monkeypatch.setenv('_PKM_COMPLETE', 'complete_bash')
        monkeypatch.setenv('COMP_WORDS', typed)
        monkeypatch.setenv('COMP_CWORD', str(typed.count(' ')))
        script = "import sys; from pkm_core.app import app; app(prog_name='pkm')"
        return run(script).stdout.split()

    def values(option):
        return set(offered(f'pkm run {option} '))

    assert {'bag-doctor', 'bag-play', 'budget'} <= set(offered('pkm b'))
    assert offered('pkm margins --machine p') == ['planar']
    assert values('--machine') == {'four_dof', 'planar', 'xy_stage'}
    assert offered('pkm layouts --machine p') == ['parallel_layout', 'planar']
    assert values('--motion') == {path.stem for path in Path('config/motions').glob('*.yaml')}
    assert values('--law') == {*(path.stem for path in Path('config/learning').glob('*.yaml')), 'none'}
    assert {'robust', 'computed_torque', 'four_dof_thesis'} <= values('--controller')
    assert {'ideal', 'nominal', 'hard', 'geometric', 'warm', 'flexible', 'elastic'} <= values('--environment')
    assert offered('pkm run --machine xy_stage --without joint_') == ['joint_controller_x', 'joint_controller_y']
    assert offered('pkm run --arrangement p') == ['processes']
    assert offered('pkm tune --mach') == ['--machine']
