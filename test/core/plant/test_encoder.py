"""Encoder: rounding, noise, interpolation error, latency."""

import numpy as np
import pytest

from pkm_core.machines import load_machine
from pkm_core.plant.encoder import encoder_count
from pkm_core.plant.plant import Plant

RESOLUTION, PERIOD = 0.2e-6, 20e-6


@pytest.mark.parametrize(('position', 'count'), [(0.1e-6, 0), (0.21e-6, 1), (-0.1e-6, -1), (79.50001e-3, 397500)])
def test_reading_rounds_down(position, count):
    assert encoder_count(position, RESOLUTION, PERIOD, 0.0, 0.0) == count


def test_interpolation_error_repeats_with_the_signal_period():
    x = 0.05 + np.arange(20000) * 1e-9 + 0.5e-9
    readings = np.array([encoder_count(p, RESOLUTION, PERIOD, 0.4e-6, 0.0) for p in x])
    error = readings * RESOLUTION + 0.5 * RESOLUTION - x
    # 0.4 (sin + sin 2x / 2) has its top of 1.3 * 0.4 um at 60 deg; half a count of rounding either way
    assert error.max() == pytest.approx(0.52e-6, abs=0.11e-6)
    assert abs(error.mean()) < 2e-9
    further = np.array([encoder_count(p + 7 * PERIOD, RESOLUTION, PERIOD, 0.4e-6, 0.0) for p in x[::50]])
    assert np.abs(further - readings[::50] - 700).max() <= 1  # rounding of positions that lie on an edge


def test_noise_of_a_resting_machine_is_within_one_count():
    plant = Plant(load_machine('xy_stage'), 5, 'nominal')
    errors = []
    for _ in range(2000):
        counts = plant.tick([0.0, 0.0])
        errors.append(counts - plant.truth.q / RESOLUTION)
    errors = np.array(errors) - np.mean(errors, axis=0)
    # uniform +-1 and rounding: sqrt(1/3 + 1/12) = 0.65; interpolation error stands still
    np.testing.assert_allclose(errors.std(axis=0), 0.65, atol=0.05)
    assert np.abs(errors).max() < 2.0


def test_ideal_reading_is_the_rounded_true_position():
    plant = Plant(load_machine('four_dof'), 5, 'ideal')
    for _ in range(50):
        counts = plant.tick([0.3, -0.3, 0.2, 0.1])
        np.testing.assert_array_equal(counts, np.floor(plant.truth.q / RESOLUTION))


def test_reading_of_a_moving_machine_is_late_and_offset():
    plant = Plant(load_machine('xy_stage'), 5, 'nominal')
    offset = plant.machine.home - plant.truth.q
    for _ in range(60):
        plant.tick([1.5, 0.0])
    lags = []
    for _ in range(40):
        counts = plant.tick([1.5, 0.0])
        truth = plant.truth
        lags.append((truth.q + offset - (counts + 0.5) * RESOLUTION) / truth.qd)
    # 2 us; 0.65 counts of noise and 50 nm of interpolation error over 0.3 m/s, 40 readings
    assert np.mean(lags, axis=0)[0] == pytest.approx(2e-6, abs=0.3e-6)
