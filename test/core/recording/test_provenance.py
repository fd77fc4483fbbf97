"""Hash of the configuration: of files as they were loaded, see the docstrings of provenance.py."""

import shutil

import pytest

from pkm_core.config import config_folder
from pkm_core.recording.provenance import config_hash, loop_hash

MOTION = 'four_dof_70ms'


@pytest.fixture
def config(tmp_path, monkeypatch):
    """Return a copy of the configuration that is in use."""
    folder = shutil.copytree(config_folder(), tmp_path / 'config')
    monkeypatch.setenv('PKM_CONFIG', str(folder))
    return folder


def edit(file):
    file.write_text(file.read_text() + '# edited\n')


@pytest.mark.parametrize('kind', ['machines', 'model', 'control'])
def test_loop_hash_follows_every_file_of_the_loop(config, kind):
    before = loop_hash('four_dof')
    assert loop_hash('four_dof') == before
    edit(config / kind / 'planar.yaml')
    assert loop_hash('four_dof') == before
    edit(config / kind / 'four_dof.yaml')
    assert loop_hash('four_dof') != before


@pytest.mark.parametrize(('kind', 'name'), [('motions', MOTION), ('learning', 'fourier')])
def test_config_hash_follows_motion_and_law(config, kind, name):
    before = config_hash(['0a'], MOTION, 'fourier')
    assert config_hash(['0a'], MOTION, 'fourier') == before
    edit(config / kind / f'{name}.yaml')
    assert config_hash(['0a'], MOTION, 'fourier') != before


def test_config_hash_counts_equal_loops_once_in_any_order():
    assert config_hash(['0a', '0b', '0a'], MOTION, 'none') == config_hash(['0b', '0a'], MOTION, 'none')
    assert config_hash(['0a', '0b'], MOTION, 'none') != config_hash(['0a'], MOTION, 'none')


def test_config_hash_leaves_out_names_without_a_file():
    assert config_hash(['0a'], 'poses', 'none') == config_hash(['0a'], 'd3_sweep_0', '')
