"""Drive: converter, current loop of Fig. 6.10, limits, ripple, commutation, back EMF."""

import numpy as np
import pytest

from pkm_core.machines import load_machine
from pkm_core.plant.drive import (
    current_loop_response,
    current_step,
    dac_output,
    emf_step,
    limited_current,
    motor_thrust,
    phase_currents,
    shorted_damping,
)
from pkm_core.plant.plant import Plant
from pkm_core.plant.truth import load_truth

STEP = 20.0 / 65536.0  # V a code
LAG = 1.0 / (2.0 * np.pi * 7420.0)
WINDING = 0.36e-3 / 0.96


@pytest.mark.parametrize(
    ('volts', 'expected'),
    [
        (0.0, 0.0),
        (0.49 * STEP, 0.0),
        (0.51 * STEP, STEP),
        (-0.51 * STEP, -STEP),
        (25.0, 10.0 - STEP),
        (-25.0, -10.0),
        (1e300, 10.0 - STEP),
    ],
)
def test_converter_rounds_to_codes_and_saturates(volts, expected):
    assert dac_output(volts, 10.0, STEP) == pytest.approx(expected, abs=1e-12)


def test_current_loop_has_the_measured_corner_and_phase():
    drive = load_truth(load_machine('four_dof'), 'ideal')[0].drive
    low, one, two, corner = current_loop_response([100.0, 1000.0, 2000.0, 7420.0], drive)
    assert 20.0 * np.log10(abs(corner / low)) == pytest.approx(-3.01, abs=0.01)
    assert np.degrees(np.angle(one)) == pytest.approx(-8.72, abs=0.01)
    assert 20.0 * np.log10(abs(one / low)) == pytest.approx(-0.08, abs=0.005)
    assert 20.0 * np.log10(abs(two / low)) == pytest.approx(-0.30, abs=0.005)


def test_current_step_is_exact_at_any_duration():
    def after(durations):
        current = charge = 0.0
        for duration in durations:
            current, part = current_step(current, 2.0, np.exp(-duration / LAG), LAG, duration)
            charge += part
        return current, charge

    once, often = after([80e-6]), after([5e-6] * 16)
    np.testing.assert_allclose(once, often, rtol=1e-13)
    np.testing.assert_allclose(once[0], 2.0 * (1.0 - np.exp(-80e-6 / LAG)), rtol=1e-13)
    np.testing.assert_allclose(once[1], 2.0 * 80e-6 - LAG * once[0], rtol=1e-12)


def test_peak_current_is_allowed_until_the_thermal_limit():
    assert limited_current(15.0, 0.0, 3.0, 12.5) == 12.5
    assert limited_current(-15.0, 0.0, 3.0, 12.5) == -12.5
    assert limited_current(-2.0, 0.0, 3.0, 12.5) == -2.0
    assert limited_current(15.0, 9.1, 3.0, 12.5) == pytest.approx(3.0 * np.sqrt(2.0))


def test_stalled_drive_is_limited_to_its_continuous_current():
    plant = Plant(load_machine('planar'), 1, 'ideal')
    pushing = np.array([-10.0, 10.0])  # into the stops
    for _ in range(600):
        plant.tick(pushing)
    np.testing.assert_allclose(np.abs(plant.truth.current), 12.5, rtol=1e-3)
    for _ in range(2400):
        plant.tick(pushing)
    # tau = 10 s from cold: 12.5^2 / 2 (1 - exp(-t / 10)) reaches 3^2 after 1.2 s
    np.testing.assert_allclose(np.abs(plant.truth.current), 3.0 * np.sqrt(2.0), rtol=1e-3)


def test_phases_sum_to_zero_with_thrust_independent_of_position():
    position = np.linspace(0.0, 0.03, 50)
    currents = phase_currents(2.0, position, 0.03)
    np.testing.assert_allclose(currents.sum(axis=0), 0.0, atol=1e-14)
    assert currents.shape == (3, 50)
    np.testing.assert_allclose((currents**2).sum(axis=0), 1.5 * 2.0**2, rtol=1e-12)
    angle = 2.0 * np.pi * position / 0.03 + np.pi / 2.0
    emf = np.cos(angle + np.array([[0.0], [2.0], [-2.0]]) * np.pi / 3.0)  # shape of each phase's EMF
    np.testing.assert_allclose((currents * emf).sum(axis=0), 1.5 * 2.0, rtol=1e-12)


def test_truth_has_the_phase_currents():
    plant = Plant(load_machine('planar'), 1, 'ideal')
    for _ in range(3):
        plant.tick([0.8, 0.0])
    truth = plant.truth
    assert truth.phase_currents.shape == (3, 2)
    assert np.abs(truth.phase_currents[:, 0]).max() <= truth.current[0]
    assert truth.current[0] == pytest.approx(0.8 * 1.25, rel=1e-3)


def test_ripple_repeats_each_pitch_and_cogging_twice_as_often():
    x = np.arange(300) * 1e-4

    def thrust(current, ripple, cogging):
        return np.array([motor_thrust(current, p, 8.8, ripple, cogging, 0.03) for p in x])

    ripple = thrust(1.0, 0.015, 0.0)
    assert ripple.max() / 8.8 == pytest.approx(1.015, abs=1e-4)
    assert ripple.mean() == pytest.approx(8.8, rel=1e-12)
    cogging = thrust(0.0, 0.015, 0.05)
    assert cogging.max() == pytest.approx(0.05, rel=1e-3)
    np.testing.assert_allclose(cogging[:150], cogging[150:], atol=1e-12)
    assert np.abs(thrust(0.0, 0.015, 0.0)).max() == 0.0


def test_shorted_damping_follows_force_constant_and_resistance():
    # three phases of 0.48 ohm, Kf = 12.5 N/A rms: 12.5^2 / (3 * 0.48)
    assert shorted_damping(12.5 / np.sqrt(2.0), 0.96) == pytest.approx(12.5**2 / 1.44)


@pytest.mark.parametrize('substep', [31.25e-6, 7.8125e-6])
def test_back_emf_under_current_control_acts_as_two_grams(substep):
    damping = 108.5
    short = loop = speed = 0.0
    decays = np.exp(-substep / WINDING), np.exp(-substep / LAG)
    for _ in range(int(5e-3 / substep)):  # 10 m/s^2, long against both lags
        short, loop, force = emf_step(
            short, loop, speed + 5.0 * substep, damping, WINDING, decays[0], LAG, decays[1], substep, False
        )
        speed += 10.0 * substep
    assert force == pytest.approx(-damping * LAG * 10.0, rel=1e-4)  # exp(-5 ms / 0.375 ms) remains
    assert damping * LAG == pytest.approx(2.33e-3, rel=1e-2)


def test_current_is_continuous_when_shorted_and_released():
    substep, damping = 1e-6, 108.5
    short = loop = 0.0
    decays = np.exp(-substep / WINDING), np.exp(-substep / LAG)
    forces = []
    for k in range(9000):
        shorted = 3000 <= k < 6000
        short, loop, force = emf_step(short, loop, 0.2, damping, WINDING, decays[0], LAG, decays[1], substep, shorted)
        forces.append(force)
    # steepest: the loop takes the 21.7 N of the brake away within 21 us
    assert np.abs(np.diff(forces)).max() < 1.1 * damping * 0.2 * substep / LAG
    assert forces[5999] == pytest.approx(-damping * 0.2, rel=1e-3)
    assert abs(forces[-1]) < 1e-3
