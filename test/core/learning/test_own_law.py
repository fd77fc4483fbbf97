"""User-defined learning laws: the two files of docs/own_law.md."""

import re
from pathlib import Path

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError, LearningError
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

PAGE = (Path(__file__).resolve().parents[3] / 'docs' / 'own_law.md').read_text(encoding='utf-8')
LAW, PARAMETERS = (re.search(rf'```{kind}\n(.*?)```', PAGE, re.DOTALL)[1] for kind in ('python', 'yaml'))
LAW += """

class Unfinished(FrequencyLaw):
    pass
"""
PLANAR = load_machine('planar')


@pytest.fixture
def write(tmp_path):
    def write(parameters=PARAMETERS, law=LAW):
        (tmp_path / 'my_law.py').write_text(law)
        (tmp_path / 'mine.yaml').write_text(parameters)
        return tmp_path / 'mine.yaml'

    return write


def test_own_law_learns_on_the_machine(write):
    gains = load_control(PLANAR)
    law = make_law(str(write()), PLANAR, gains)
    trajectory = to_joints(PLANAR, plan(PLANAR, load_motion('planar_80ms')))
    records = run_cycles(PLANAR, trajectory, gains, law, 4, 1)
    errors = np.abs(records.error).max(axis=(1, 2))
    assert errors[-1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    ('old', 'new', 'error', 'words'),
    [
        ('6000.0', '600000.0', LearningError, 'mine.yaml.* would diverge'),
        ('my_law.py:MyLaw', 'magic', ConfigError, r"mine.yaml: law: 'magic' given; expected .*'basis', .*or e.g."),
        ('my_law.py:MyLaw', '[fourier]', ConfigError, r'mine.yaml: law: \[.*expected one of'),
        ('law: my_law.py:MyLaw', '', ConfigError, 'mine.yaml: law: None given; expected one of'),
        ('my_law.py:MyLaw', 'your_law.py:MyLaw', ConfigError, 'your_law.py: no such file'),
        ('my_law.py:MyLaw', 'my_law.py:YourLaw', ConfigError, 'my_law.py has no class YourLaw derived from .*Law'),
        ('my_law.py:MyLaw', 'my_law.py:Unfinished', ConfigError, r"does not define \['action', 'memory'\]"),
        ('my_law.py:MyLaw', 'my_law.py:np', ConfigError, 'has no class np'),
        ('proportional', 'proportionate', ConfigError, "mine.yaml: unknown key 'proportionate'; known: "),
    ],
)
def test_unfit_own_law_is_refused(write, old, new, error, words):
    path = write(PARAMETERS.replace(old, new))
    with pytest.raises(error, match=words):
        make_law(str(path), PLANAR, load_control(PLANAR))


def test_own_file_that_fails_on_import_is_refused_with_its_error(write):
    path = write(law='import no_such_module')
    with pytest.raises(ConfigError, match=r'my_law\.py cannot be imported: ModuleNotFoundError: .*no_such_module'):
        make_law(str(path), PLANAR, load_control(PLANAR))
