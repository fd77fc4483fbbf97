"""Noise: a pure function of seed, cycle and index, with the configured levels."""

import numpy as np
import pytest

from pkm_core.machines import load_machine
from pkm_core.plant.arrays import AMPLIFIER, ENCODER, FLOOR
from pkm_core.plant.noise import CycleNoise
from pkm_core.plant.truth import load_truth


def noise(seed=3, environment='hard'):
    machine = load_machine('four_dof')
    truth, levels = load_truth(machine, environment)
    directions = [axis.direction for axis in truth.axes.values()]
    return CycleNoise(seed, levels, directions, truth.vibration_band, machine.sample_time)


def draws(source, cycle, indices):
    source.start(cycle)
    blocks = (source.at(index) for index in indices)
    return np.array([block[:, row] for block, row in blocks])


def test_draws_do_not_depend_on_the_order_of_indices():
    forward = draws(noise(), 5, range(3000))
    picked = [2999, 0, 1023, 1024, 17]
    np.testing.assert_array_equal(draws(noise(), 5, picked), forward[picked])


def test_draws_of_different_cycles_and_seeds_differ():
    first = draws(noise(), 5, range(1000))
    for other in (draws(noise(), 6, range(1000)), draws(noise(seed=4), 5, range(1000))):
        for kind in (ENCODER, AMPLIFIER, FLOOR):
            assert abs(np.corrcoef(first[:, kind, 0], other[:, kind, 0])[0, 1]) < 0.2  # 1000 draws; floor: 24 tones


def test_strengths_are_those_of_the_environment():
    many = np.concatenate([draws(noise(), cycle, range(1000)) for cycle in range(10)])
    assert np.abs(many[:, ENCODER]).max() <= 2.0
    assert many[:, ENCODER].std() == pytest.approx(2.0 / np.sqrt(3.0), rel=0.02)
    assert many[:, AMPLIFIER].std() == pytest.approx(5e-3, rel=0.02)
    assert many[:, FLOOR].std() == pytest.approx(20e-3, rel=0.1)


def test_joints_of_one_direction_share_the_floor_vibration():
    floor = draws(noise(), 1, range(1000))[:, FLOOR]
    np.testing.assert_array_equal(floor[:, 0], floor[:, 1])
    np.testing.assert_array_equal(floor[:, 2], floor[:, 3])
    assert not np.array_equal(floor[:, 0], floor[:, 2])


def test_floor_vibration_is_within_its_band():
    spectrum = np.abs(np.fft.rfft(draws(noise(), 1, range(4000))[:, FLOOR, 0]))
    frequencies = np.fft.rfftfreq(4000, 0.5e-3)
    inside = (frequencies > 18.0) & (frequencies < 82.0)
    assert (spectrum[inside] ** 2).sum() > 0.99 * (spectrum**2).sum()


def test_factors_of_a_cycle_have_the_configured_spread():
    source, factors = noise(), []
    for cycle in range(300):
        source.start(cycle)
        factors.append([source.friction, source.gain])
    friction, gain = np.moveaxis(factors, 1, 0)
    assert np.abs(friction - 1.0).max() <= 0.1
    assert friction.std() == pytest.approx(0.1 / np.sqrt(3.0), rel=0.1)
    assert gain.std() == pytest.approx(0.5e-2, rel=0.1)
