"""The platform's spring: its response, its settled position, and that only the laser measures it."""

import numpy as np
import pytest

from pkm_core.machines import load_machine
from pkm_core.plant.laser import Laser
from pkm_core.plant.plant import Plant
from pkm_core.plant.platform import Platform
from pkm_core.plant.truth import load_truth

TICK = 0.5e-3
GIVEN = load_truth(load_machine('four_dof'), 'nominal')[0].platform


def test_constant_acceleration_deflects_a_damped_spring():
    off, rate = Platform(GIVEN, 1, TICK).follow(4.0 * TICK * np.arange(800)[:, np.newaxis])
    w, z = 2.0 * np.pi * GIVEN.resonance, GIVEN.damping
    t, wd = TICK * np.arange(800), w * np.sqrt(1.0 - z * z)
    rest = -4.0 / w**2
    exact = rest * (1.0 - np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t)))
    np.testing.assert_allclose(off[:, 0], exact, atol=1e-12 * abs(rest) * len(t))
    np.testing.assert_allclose(rate[:, 0], -4.0 / wd * np.exp(-z * w * t) * np.sin(wd * t), atol=1e-12)
    assert off[-1, 0] == pytest.approx(-0.5e-6, rel=0.01)


def test_result_does_not_depend_on_the_length_of_calls():
    velocity = np.cumsum(np.random.default_rng(1).normal(0.0, 1e-3, (100, 3)), axis=0)
    whole, pieces = Platform(GIVEN, 3, TICK), Platform(GIVEN, 3, TICK)
    off, _ = whole.follow(velocity)
    joined = [pieces.follow(velocity[first : first + 12])[0][1:] for first in range(0, 99, 11)]
    np.testing.assert_array_equal(np.concatenate(joined), off[1:])


def test_laser_measures_the_platform_lag_under_acceleration():
    def off(environment):
        """Return (what the laser has seen beside joints and links, their acceleration) at ticks where both look."""
        plant = Plant(load_machine('xy_stage'), 1, environment)
        laser, path = Laser(plant.machine, 1, environment), [plant.truth.pose]
        laser.zero(0, plant.truth)
        for tick in range(1, 101):
            plant.tick([2.0, 0.0])
            laser.observe(tick, plant.truth)
            path.append(plant.truth.pose)
        acceleration = np.diff(path, 2, axis=0) / TICK**2
        at = np.arange(24, 100, 8)  # every 4 ms, when the first swing has lost a half
        return laser.read().displacement[at * 5 // 8] - (path - path[0])[at], acceleration[at].mean(axis=0)

    seen, acceleration = off('nominal')
    assert acceleration[0] > 7.0
    # 10 samples of rounding to 0.91 um, and the rest of the swing
    np.testing.assert_allclose(seen.mean(axis=0), -acceleration / (2.0 * np.pi * GIVEN.resonance) ** 2, atol=0.25e-6)
    stiff, _ = off('ideal')
    assert np.abs(stiff).max() < 0.46e-6
