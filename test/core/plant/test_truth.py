"""The truth files: all load, errors in them are named, only the plant reads them."""

import shutil

import numpy as np
import pytest

from pkm_core.config import Configuration, load_config
from pkm_core.control.controllers import make_controller
from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.plant import Plant
from pkm_core.plant.truth import Truth, load_truth


@pytest.mark.parametrize(
    'path', sorted((Configuration.of_environment().folder / 'truth').glob('*.yaml')), ids=lambda path: path.stem
)
def test_every_truth_file_has_the_three_environments(path):
    truth = load_config(path, Truth)
    assert {'ideal', 'nominal', 'hard'} <= set(truth.environments)
    assert tuple(truth.axes) == load_machine(path.stem).joints


def test_ideal_environment_has_no_imperfection():
    for name in ('four_dof', 'planar', 'xy_stage'):
        levels = load_truth(load_machine(name), 'ideal')[1].model_dump()
        assert not any(levels.values()), levels


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('substep: 62.5 us', 'substep: 62.5', 'has no unit'),
        ('substep: 62.5 us', 'substep: 60 us', 'does not divide the tick'),
        ('delay: 2.9 us', 'delay: 70 us', 'delay 7e-05 s given; allowed below substep 6.25e-05 s'),
        ('gain: 7375 mm/s^2/V', 'gain: 7375 mm/s', 'dimension'),
        ('[[d1, d3], [d7, d5]]', '[[d1, d9], [d7, d5]]', "unknown joint 'd9'"),
        ('resonance: 380 Hz', 'resonance: 238 Hz', 'must differ'),
        ('  d7:\n', '  d8:\n', "the machine has the joints|unknown joint 'd7'"),
        ('pitch: 30 mm', 'pich: 30 mm', "unknown key 'drive.pich'"),
        ('[20 Hz, 80 Hz]', '[80 Hz, 20 Hz]', 'vibration_band: 80 to 20 Hz given; allowed 0 <= lower < upper'),
        ('resolution: 0.91 um', 'resolution: 0 um', "laser.resolution: '0 um' given; allowed > 0 m"),
        ('mass: 2.3 g', 'mass: -2.3 g', "payload.mass: '-2.3 g' given"),
        ('resistance: 0.96 ohm', 'resistance: 0 ohm', "drive.resistance: '0 ohm' given"),
    ],
)
def test_wrong_truth_is_refused_by_name(old, new, message, tmp_path):
    machine = load_machine('four_dof')
    text = (Configuration.of_environment().folder / 'truth' / 'four_dof.yaml').read_text()
    assert old in text
    (tmp_path / 'truth').mkdir()
    (tmp_path / 'truth' / 'four_dof.yaml').write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=message):
        load_truth(machine.with_configuration(Configuration(tmp_path)), 'nominal')


def test_belts_without_their_section_are_refused(tmp_path):
    machine = load_machine('planar')
    text = (Configuration.of_environment().folder / 'truth' / 'planar.yaml').read_text()
    (tmp_path / 'truth').mkdir()
    (tmp_path / 'truth' / 'planar.yaml').write_text(text.replace('belts: false', 'belts: true'))
    with pytest.raises(ConfigError, match='has no section belts'):
        load_truth(machine.with_configuration(Configuration(tmp_path)), 'ideal')


def test_controllers_work_without_a_readable_truth(tmp_path):
    """The plant does not."""
    shutil.copytree(Configuration.of_environment().folder, tmp_path / 'config', ignore=shutil.ignore_patterns('truth'))
    without_truth = Configuration(tmp_path / 'config')
    for name in ('four_dof', 'planar'):
        machine = load_machine(name, without_truth)
        trajectory = to_joints(machine, plan(machine, load_motion(default_motion(machine))))
        gains = load_control(machine)
        controller = make_controller(machine, gains)
        controller.load(trajectory, np.zeros(trajectory.position.shape))
        voltages, _ = controller.update(0, machine.home)
        law = make_law('fourier_pid', machine, gains)
        learned = law.update(
            machine.joints[0], np.zeros(len(trajectory)), np.zeros(len(trajectory)), 0, machine.sample_time
        )
        assert np.isfinite(voltages).all()
        assert np.isfinite(learned).all()
        with pytest.raises(ConfigError, match='truth'):
            Plant(machine, 1)
