"""Geometry of a real machine: draw, independence of the joints, agreement with the calibrator's kinematics, laser."""

from dataclasses import replace

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.design.geometry import geometry_names
from pkm_core.design.specimen import end_point as specimen_end_point
from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_core.machines.built import drawn_length
from pkm_core.machines.real_geometry import end_point, guide_ends
from pkm_core.plant.geometry import WAVES
from pkm_core.plant.laser import Laser
from pkm_core.plant.plant import Plant
from pkm_core.plant.specimen import assemble
from pkm_core.plant.truth import load_truth

MACHINES = ('four_dof', 'planar', 'xy_stage')


def specimen(name, seed=3, environment='geometric'):
    machine = load_machine(name)
    return machine, assemble(machine, *load_truth(machine, environment), seed)


def joints(machine, rows=50):
    return np.random.default_rng(1).uniform(machine.limits.lower, machine.limits.upper, (rows, len(machine.joints)))


@pytest.mark.parametrize('name', MACHINES)
def test_geometric_plant_has_joints_of_nominal(name):
    """The geometry is kinematic only: the same volts give the same bits of counts and joints."""
    machine = load_machine(name)
    plants = [Plant(machine, 3, environment) for environment in ('nominal', 'geometric')]
    for tick in range(60):
        volts = np.full(len(machine.joints), 0.5 * np.cos(0.1 * tick))
        first, second = (plant.tick(volts) for plant in plants)
        np.testing.assert_array_equal(first, second)
    nominal, geometric = (plant.truth for plant in plants)
    np.testing.assert_array_equal(nominal.q, geometric.q)
    assert nominal.assembly.lengths == geometric.assembly.lengths
    assert (np.abs(nominal.pose - geometric.pose) > 1e-9).all()


@pytest.mark.parametrize('name', MACHINES)
def test_geometry_at_zero_is_the_assembly_without(name):
    machine, real = specimen(name)
    flat = replace(real, scale=0.0 * real.scale, waves=0.0 * real.waves, turned=0.0 * real.turned)
    q, belts = joints(machine), np.zeros((50, 0))
    plain = specimen(name, environment='nominal')[1].end_point(q, belts)
    np.testing.assert_allclose(flat.end_point(q, belts), plain, rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(flat.end_point(q[0], belts[0]), flat.end_point(q, belts)[0])


@pytest.mark.parametrize('name', ['four_dof', 'planar'])
def test_truth_agrees_with_calibrated_kinematics(name):
    """Two implementations: turns, height, scales, belts and lengths. Shapes of guides differ, so they are off here."""
    machine, real = specimen(name)
    real = replace(real, waves=0.0 * real.waves)
    q, belts = joints(machine), np.tile([1e-4, -2e-4], (50, 1))
    at = {
        **real.lengths,
        **{name: getattr(real.offsets, name) for name in ('dx', 'dy', 'dz') if hasattr(real.offsets, name)},
        **{f'scale_{joint}': scale for joint, scale in zip(machine.joints, real.scale, strict=True)},
        **dict(zip(('square', 'pitch', 'roll', 'height'), real.turned, strict=True)),
        **{'psi_p': 1e-4, 'psi_q': -2e-4},
    }
    expected = end_point(machine.config.mechanism, q, at, guide_ends(machine.limits))
    np.testing.assert_allclose(real.end_point(q, belts), expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('name', ['four_dof', 'planar'])
def test_named_errors_of_the_truth_reproduce_its_end_point(name):
    """But for the short waves of the guides, which have no name: 0.1 um of some micrometres."""
    machine, real = specimen(name)
    q = joints(machine)
    named = real.geometry_errors(machine.joints)
    assert set(named) == set(geometry_names(machine))
    lengths = {link: length - drawn_length(machine.config.geometry, link) for link, length in real.lengths.items()}
    true = real.end_point(q, np.zeros((50, 0)))
    off = true - specimen_end_point(machine, q, lengths | named)
    without = true - specimen_end_point(machine, q, lengths)
    assert off[:, :2].std(axis=0).max() < 0.12e-6
    assert (without[:, :2].std(axis=0) > 3.0 * off[:, :2].std(axis=0)).all()


def test_stage_follows_its_guides():
    """One error at a time, by hand: scale, squareness, straightness."""
    real = specimen('xy_stage')[1]
    none = replace(real, scale=np.zeros(2), waves=0.0 * real.waves, turned=np.zeros(4))
    q, belts = np.array([0.01, 0.03]), np.zeros(0)
    np.testing.assert_array_equal(none.end_point(q, belts), q)
    scaled = replace(none, scale=np.array([1e-5, -2e-5])).end_point(q, belts)
    np.testing.assert_allclose(scaled - q, [0.1e-6, -0.6e-6], rtol=1e-6)
    turned = replace(none, turned=np.array([1e-4, 0.0, 0.0, 0.0])).end_point(q, belts)
    np.testing.assert_allclose(turned - q, [-3e-6, 0.0], atol=1e-9)
    waves = np.zeros((2, 2, WAVES + 1, 2))
    waves[0, 0, 0, 1] = 1e-6  # a sine over the travel of 40 mm of the X guide
    np.testing.assert_allclose(replace(none, waves=waves).end_point(q, belts) - q, [0.0, 1e-6], atol=1e-12)


def test_guides_deviate_from_their_best_line():
    """Over specimens: 0.5 um at most on average, and neither level nor slope."""
    largest = []
    for seed in range(30):
        real = specimen('xy_stage', seed)[1]
        none = replace(real, scale=np.zeros(2), turned=np.zeros(4), waves=real.waves * [[[[1.0]]], [[[0.0]]]])
        x = np.linspace(*real.travel[0], 2001)
        side = none.end_point(np.stack([x, 0.0 * x], axis=-1), np.zeros((2001, 0)))[:, 1]
        largest.append(np.abs(side).max())
        slope, level = np.polyfit(x - x.mean(), side, 1)
        assert abs(level) < 2e-9
        assert abs(slope) * 0.04 < 5e-9
    assert np.mean(largest) == pytest.approx(0.5e-6, rel=0.25)


def test_laser_reads_along_its_own_axes():
    """Every 4 ms a sample coincides with a tick; the mean error there tells the axes of the laser from the base's."""
    machine = load_machine('planar')
    plant, laser = Plant(machine, 8, 'geometric'), Laser(machine, 8, 'geometric')
    axes, poses = plant.truth.assembly.laser_axes, [plant.truth.pose]
    laser.zero(0, plant.truth)
    for tick in range(1, 401):
        plant.tick([1.0, 0.2] if tick < 60 else [0.0, 0.0])
        laser.observe(tick, plant.truth)
        poses.append(plant.truth.pose)
    moved = np.array(poses[120:400:8]) - poses[0]  # after the acceleration, which bends the platform
    shown = laser.read().displacement[75::5]
    assert np.abs(moved @ (axes - np.eye(2)).T).mean(axis=0).min() > 0.4e-6
    np.testing.assert_allclose((shown - moved @ axes.T).mean(axis=0), 0.0, atol=0.2e-6)  # 35 samples of 0.33 um


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('square: 50 urad', 'square: 50', r'environments.geometric.geometry.square: 50 has no unit'),
        ('scale: 5 ppm', 'scale: -5 ppm', "geometry.scale: '-5 ppm' given"),
        ('straightness: 0.3 um', 'straightness: 0.3 mm', "straightness: '0.3 mm' given"),
        ('height: 10 um', 'heigth: 10 um', 'heigth'),
    ],
)
def test_wrong_geometry_is_refused_by_key(old, new, message, tmp_path):
    machine = load_machine('planar')
    text = (Configuration.of_environment().folder / 'truth' / 'planar.yaml').read_text()
    assert old in text
    (tmp_path / 'truth').mkdir()
    (tmp_path / 'truth' / 'planar.yaml').write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=message):
        load_truth(machine.with_configuration(Configuration(tmp_path)), 'geometric')
