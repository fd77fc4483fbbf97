"""Friction of a guide: sticking, creeping, sliding, dissipation."""

import numpy as np
import pytest

from pkm_core.machines import load_machine
from pkm_core.plant.friction import bristle_step
from pkm_core.plant.plant import Plant

COULOMB, BREAKAWAY, STRIBECK, STIFFNESS, DAMPING, ELASTIC = 0.5, 1.1, 5e-3, 50e3, 50.0, 0.5
H = 31.25e-6


def step(bristle, speed, duration=H):
    return bristle_step(bristle, speed, duration, COULOMB, BREAKAWAY, STRIBECK, STIFFNESS, DAMPING, ELASTIC)


def slide(speed, distance, bristle=0.0, duration=H):
    force = 0.0
    for _ in range(round(distance / abs(speed) / duration)):
        bristle, force = step(bristle, speed, duration)
    return bristle, force


@pytest.mark.parametrize('sign', [-1.0, 1.0])
@pytest.mark.parametrize(
    ('speed', 'level'), [(0.3, 0.5), (20e-3, 0.5), (5e-3, 0.5 * (1.0 + 0.1 / np.e)), (0.05e-3, 0.55)]
)
def test_sliding_force_follows_the_stribeck_curve(speed, level, sign):
    _, force = slide(sign * speed, 200e-6 if speed < 1e-3 else 3e-3)
    assert force == pytest.approx(sign * level, rel=1e-3)


def test_small_motion_is_elastic_without_loss():
    there, force = slide(1e-3, 4e-6)  # 5.5 um are elastic
    assert force == pytest.approx(STIFFNESS * 4e-6 + DAMPING * 1e-3 * np.exp(-0.04), rel=0.02)  # half a substep of bend
    back, _ = slide(-1e-3, 4e-6, there)
    assert abs(back) < 1e-12


def test_larger_motion_has_hysteresis():
    there, _ = slide(1e-3, 40e-6)
    back, force = slide(-1e-3, 40e-6, there)
    assert force < -0.5
    assert back < -9e-6


def test_vibration_does_not_make_a_loaded_guide_creep():
    # 0.2 N held, vibration of 10 mm/s at 50 Hz: the deflection is in the elastic share, the mean stays
    bristle, forces = 4e-6, []
    for k in range(64000):
        speed = 0.2e-3 * np.cos(2.0 * np.pi * 50.0 * k * H)
        bristle, force = step(bristle, speed)
        forces.append(force)
    assert np.mean(forces[-640:]) == pytest.approx(0.2, abs=2e-3)


def test_friction_dissipates_energy_over_a_closed_path():
    rng = np.random.default_rng(3)
    for scale in (1e-4, 3e-3, 0.1, 1.0):
        speeds = np.cumsum(rng.normal(0.0, scale * 0.05, 20000))
        bristle, work = 0.0, 0.0
        for speed in speeds:
            bristle, force = step(bristle, speed)
            work += force * speed * H
        assert work >= 0.5 * STIFFNESS * bristle**2 - 1e-12  # what the bristles still store came from that work


@pytest.mark.parametrize('duration', [1e-6, 1e-4, 1e-2])
def test_force_is_bounded_at_any_step_and_speed(duration):
    bristle = 0.0
    for speed in np.random.default_rng(4).normal(0.0, 1.0, 2000):
        bristle, force = step(bristle, speed, duration)
        assert abs(bristle) <= 0.55 / STIFFNESS * (1.0 + 1e-12)
        assert np.isfinite(force)


def test_no_coulomb_force_means_no_friction():
    assert bristle_step(1e-6, 0.1, H, 0.0, BREAKAWAY, STRIBECK, STIFFNESS, DAMPING, ELASTIC) == (0.0, 0.0)


def test_pushed_guide_sticks_within_micrometres_and_springs_back():
    plant = Plant(load_machine('planar'), 1, 'nominal')
    start = plant.truth.q
    for _ in range(400):
        plant.tick([0.02, 0.02])  # 0.22 N of the 0.55 that break it away
    bent = plant.truth.q - start
    assert ((bent > 2e-6) & (bent < 8e-6)).all()
    for _ in range(400):
        plant.tick([0.0, 0.0])
    assert np.abs(plant.truth.q - start).max() < 1e-6  # 0.2 um rms of shaking by 2 mV and the floor


def test_pushed_guide_breaks_away_above_its_static_force():
    plant = Plant(load_machine('planar'), 1, 'nominal')
    start = plant.truth.q
    for _ in range(400):
        plant.tick([0.07, 0.07])  # 0.77 N
    assert (plant.truth.q - start > 1e-3).all()
