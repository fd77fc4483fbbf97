"""Resampling of the laser's record onto the ticks: no delay, no gain, and refusal of incomplete records."""

import numpy as np
import pytest

from pkm_core.errors import LearningError
from pkm_core.learning.laser_record import at_ticks, check_record, cycle_times, error_samples
from pkm_core.machines import load_machine
from pkm_core.machines.laser_clock import sample_numbers
from pkm_core.motion.trajectory import SampledTrajectory

TS, LASER = 0.5e-3, 0.8e-3
STEP, NOISE = 0.91e-6, 0.2e-6  # of config/truth, nominal
SAMPLES = 679  # a cycle that is no multiple of the laser's period


def laser_times(first_tick, samples=SAMPLES):
    machine = load_machine('four_dof')
    numbers = sample_numbers(machine, first_tick, first_tick + samples)
    return cycle_times(machine, numbers * LASER, first_tick)


def test_band_limited_periodic_signal_is_returned_exactly():
    draw = np.random.default_rng(1)
    series = np.zeros(SAMPLES // 2 + 1, dtype=complex)
    series[:51] = draw.standard_normal(51) + 1j * draw.standard_normal(51)  # up to 147 Hz
    period, time = SAMPLES * TS, laser_times(12345)
    series[0] = series[0].real

    def signal(t):
        turns = np.exp(2j * np.pi * np.outer(t / period, np.arange(1, 51)))
        return series[0].real + 2 * (turns @ series[1:51]).real

    found = at_ticks(time, signal(time)[:, np.newaxis], SAMPLES, TS, 150.0)[:, 0]
    np.testing.assert_allclose(found, signal(np.arange(SAMPLES) * TS), atol=1e-10)


@pytest.mark.parametrize('harmonic', [3, 12, 35])
def test_quantised_sinusoid_has_no_delay_and_no_gain(harmonic):
    """
    Over eight cycles with the laser's clock at other phases, 50 um at 9, 35 and 103 Hz.

    Linear interpolation of samples every 0.8 ms loses 2 % at 103 Hz, and holding them delays by 0.4 ms. The noise of a
    sample, 0.33 um, leaves 0.33 sqrt(2/425/8) = 0.008 um of amplitude: 0.02 % and 0.16 mrad.
    """
    frequency, amplitude, draw = harmonic / (SAMPLES * TS), 50e-6, np.random.default_rng(harmonic)
    ticks, found = np.arange(SAMPLES) * TS, []
    for cycle in range(8):
        time = laser_times(cycle * SAMPLES)
        seen = amplitude * np.sin(2 * np.pi * frequency * time) + NOISE * draw.standard_normal(time.size)
        seen = STEP * np.round(seen / STEP)
        values = at_ticks(time, seen[:, np.newaxis], SAMPLES, TS, 150.0)[:, 0]
        found.append(2j * np.mean(values * np.exp(-2j * np.pi * frequency * ticks)))
    ratio = np.mean(found) / amplitude
    assert abs(ratio) == pytest.approx(1.0, abs=1e-3)
    assert abs(np.angle(ratio)) < 1e-3  # 1.5 us at 103 Hz


def test_reference_between_ticks_is_exact_to_a_nanometre():
    """A machine that follows its reference exactly has no error at any sample of the laser."""
    w = 2 * np.pi / (SAMPLES * TS) * 7  # 21 Hz, 4 mm

    def motion(t):
        return [4e-3 * (1 - np.cos(w * t)), 4e-3 * w * np.sin(w * t), 4e-3 * w**2 * np.cos(w * t)]

    p, v, a = (row[:, np.newaxis] for row in motion(np.arange(SAMPLES) * TS))
    poses = SampledTrajectory(TS, ('x',), p, v, a, np.zeros_like(p), np.array([40]), np.array([600]))
    time = laser_times(777)
    time = time[time < (SAMPLES - 1) * TS]
    error = error_samples(poses, time, motion(time)[0][:, np.newaxis])
    assert np.ptp(error) < 1e-9  # h^4/384 times the fourth derivative, 1.2e6 m/s^4, is 0.2 nm


def test_times_do_not_lose_precision_with_the_age_of_the_cell():
    machine = load_machine('planar')
    late = 2_000_000_000  # ticks: eleven days
    numbers = sample_numbers(machine, late, late + 720)
    # a double of seconds resolves 0.1 ns after eleven days; the fit needs 1 us
    np.testing.assert_allclose(
        cycle_times(machine, numbers * LASER, late), numbers * LASER - late * TS, atol=1e-9, rtol=0
    )
    assert cycle_times(machine, numbers * LASER, late)[1] == 0.8e-3


TIME = np.arange(0, 0.36, LASER)


@pytest.mark.parametrize(
    ('time', 'displacement', 'expected'),
    [
        (TIME[:0], np.zeros((0, 2)), 'laser: no sample in a cycle of 360 ms'),
        (TIME, np.zeros((450, 3)), r'laser: displacement has shape \(450, 3\); expected \(450, 2\)'),
        (
            TIME,
            np.where(np.arange(900).reshape(450, 2) == 21, np.nan, 0.0),
            'laser: y is nan at 8.0 ms of the cycle; expected a finite number',
        ),
        (
            np.concatenate([TIME[:100], TIME[99:-1]]),
            np.zeros((450, 2)),
            'laser: a sample at 79.2 ms follows one at 79.2 ms of the cycle; expected rising times',
        ),
        (TIME[:300], np.zeros((300, 2)), 'laser: no sample from 239.2 to 360.0 ms of the cycle; allowed gaps up to 4'),
        (TIME[50:], np.zeros((400, 2)), 'laser: no sample from 0.0 to 40.0 ms'),
        (np.delete(TIME, range(80, 90)), np.zeros((440, 2)), 'laser: no sample from 63.2 to 72.0 ms'),
    ],
)
def test_incomplete_record_is_refused_with_place_and_time(time, displacement, expected):
    with pytest.raises(LearningError, match=expected):
        check_record(time, displacement, 0.36, ('x', 'y'), 4e-3)


def test_lost_samples_within_the_allowed_gap_are_accepted():
    check_record(np.delete(TIME, [7, 80, 81]), np.zeros((447, 2)), 0.36, ('x', 'y'), 4e-3)
