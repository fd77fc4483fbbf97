"""Hash of the configuration: of files as they were loaded, see the docstrings of provenance.py."""

import shutil

import pytest

from pkm_core.config import Configuration
from pkm_core.machines import load_machine
from pkm_core.recording.provenance import config_hash, loop_hash, machine_hash, truth_hash

MOTION = 'four_dof_70ms'


@pytest.fixture
def config(tmp_path):
    """Return a copy of the configuration."""
    return Configuration(shutil.copytree(Configuration.of_environment().folder, tmp_path / 'config'))


def edit(file):
    file.write_text(file.read_text() + '# edited\n')


@pytest.mark.parametrize('kind', ['model', 'control'])
def test_loop_hash_follows_model_gains_and_machine(config, kind):
    machine = load_machine('four_dof', config)
    before = loop_hash(machine, 'robust', '0a')
    assert loop_hash(machine, 'robust', '0a') == before
    edit(config.find(kind, 'planar'))
    edit(config.find('machines', 'four_dof'))
    assert loop_hash(machine, 'robust', '0a') == before
    assert loop_hash(machine, 'robust', '0b') != before
    edit(config.find(kind, 'four_dof'))
    assert loop_hash(machine, 'robust', '0a') != before


def test_machine_hash_follows_the_file_of_the_machine(config):
    before = machine_hash('four_dof', config)
    edit(config.find('machines', 'planar'))
    assert machine_hash('four_dof', config) == before
    edit(config.find('machines', 'four_dof'))
    assert machine_hash('four_dof', config) != before


@pytest.mark.parametrize(('kind', 'name'), [('motions', MOTION), ('learning', 'fourier'), ('learning/tool', 'laser')])
def test_config_hash_follows_motion_and_laws(config, kind, name):
    before = config_hash(['0a'], MOTION, 'fourier', config, 'laser')
    assert config_hash(['0a'], MOTION, 'fourier', config, 'laser') == before
    edit(config.find(kind, name))
    assert config_hash(['0a'], MOTION, 'fourier', config, 'laser') != before


def test_truth_hash_follows_the_file_of_the_truth(config):
    machine = load_machine('four_dof', config)
    before = truth_hash(machine)
    edit(config.find('truth', 'planar'))
    assert truth_hash(machine) == before
    edit(config.find('truth', 'four_dof'))
    assert truth_hash(machine) != before


def test_every_folder_of_the_configuration_is_in_a_hash(config):
    """Files of design and tuning lead to machine and control files, which have a hash; no cycle reads them."""
    hashed = {'control', 'learning', 'learning/tool', 'machines', 'model', 'motions', 'truth'}
    folders = {path.parent.relative_to(config.folder).as_posix() for path in config.folder.rglob('*.yaml')}
    assert folders - {'control/computed_torque', 'control/observer'} == hashed | {'design', 'tuning'}


def test_config_hash_counts_equal_loops_once_in_any_order():
    assert config_hash(['0a', '0b', '0a'], MOTION, 'none') == config_hash(['0b', '0a'], MOTION, 'none')
    assert config_hash(['0a', '0b'], MOTION, 'none') != config_hash(['0a'], MOTION, 'none')


def test_config_hash_leaves_out_names_without_a_file():
    assert config_hash(['0a'], 'poses', 'none') == config_hash(['0a'], 'd3_sweep_0', '')
