"""Common properties of all learning laws, and the arithmetic of each on its linear model."""

from functools import cache

import numpy as np
import pytest

from pkm_core.config import find_config, load_config
from pkm_core.control.computed_torque import load_torque_control
from pkm_core.control.margins import unit_circle
from pkm_core.control.robust import load_control
from pkm_core.control.systems import open_loop
from pkm_core.errors import ConfigError, LearningError
from pkm_core.learning import law_names, make_law, untested_law
from pkm_core.learning.band import Band
from pkm_core.learning.fourier import FourierConfig
from pkm_core.learning.law import closed, learned_path
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints

TS = 0.5e-3
N = 680
FREQUENCY = np.fft.rfftfreq(N, TS)
FOURIER = ('fourier', 'fourier_pid')
MACHINES = {name: load_machine(name) for name in ('four_dof', 'planar')}
GAINS = {name: load_control(machine) for name, machine in MACHINES.items()}
REFERENCE = to_joints(MACHINES['four_dof'], plan(MACHINES['four_dof'], load_motion('four_dof_70ms')))


@cache
def law(name, machine='four_dof'):
    made = make_law(name, MACHINES[machine], GAINS[machine])
    return made.with_reference(REFERENCE) if machine == 'four_dof' else made


def harmonic(n):
    return 1e-6 * np.sin(2 * np.pi * n * np.arange(N) / N)


def moved(path, feedforward):
    """Return the effect of a feedforward (N,) on the position in steady repetition."""
    return np.fft.irfft(path * np.fft.rfft(feedforward), N)


def model_path(the_law, joint):
    path = np.zeros(FREQUENCY.shape, dtype=complex)
    path[1:] = the_law.path(joint, FREQUENCY[1:])
    return path


def error_of_a_move(top):
    """Return an error (N,) [m] with content up to `top` [Hz] that is zero around the cycle's boundary."""
    rng = np.random.default_rng(1)
    spectrum = np.where((FREQUENCY > 0) & (top > FREQUENCY), 1, 0) * np.exp(2j * np.pi * rng.random(FREQUENCY.size))
    return 1e-6 * np.fft.irfft(spectrum, N) * np.sin(np.pi * np.arange(N) / N) ** 4


def test_learned_path_is_the_loop_from_voltage_before_filters():
    gains, model = GAINS['planar']['d3'], law('inverse', 'planar').models['d3']
    frequency = np.array([3.0, 40.0, 160.0])
    z = unit_circle(frequency, TS)
    loop = open_loop(gains, model, TS)(z)
    expected = loop / (1 + loop) / gains.pid_response(z, TS)  # L = PID times the rest
    np.testing.assert_allclose(learned_path(gains, model, frequency, TS), expected, rtol=1e-9)


def test_inverse_removes_the_error_in_its_band_in_one_update():
    """On the model."""
    the_law, error = law('inverse'), error_of_a_move(150.0)
    for joint in the_law.gains:
        feedforward = the_law.update(joint, error, np.zeros(N), 0, TS)
        left = error - moved(model_path(the_law, joint), feedforward)
        # the window leaks slightly above 160 Hz, and the mean is not learned
        assert np.abs(left - left.mean()).max() < 1e-3 * np.abs(error).max()


def test_norm_optimal_update_minimises_the_lifted_criterion():
    the_law, joint, samples = law('norm_optimal'), 'd5', 200
    config, frequency = the_law.config, np.fft.rfftfreq(samples, TS)
    inside = config.band.weight(frequency) == 1
    path = np.zeros(frequency.shape, dtype=complex)
    path[inside] = the_law.path(joint, frequency[inside])
    spectrum = np.fft.rfft(np.random.default_rng(2).standard_normal((2, samples)), axis=1) * inside
    error, feedforward = np.fft.irfft(spectrum, samples, axis=1) * np.array([[1e-6], [1e-2]])
    error = closed(error, TS)

    # the criterion as least squares in lifted vectors: G is circulant, S weighs second differences
    lifted = np.stack([np.roll(np.fft.irfft(path, samples), k) for k in range(samples)], axis=1)
    difference = np.eye(samples) - np.roll(np.eye(samples), 1, axis=0)
    effort = np.abs(the_law.path(joint, np.array([config.effort]))[0]) / (2 * np.sin(np.pi * config.effort * TS)) ** 2
    change = np.sqrt(config.change) * np.abs(the_law.path(joint, np.arange(1.0, config.band.fall_to))).max()
    rows = np.vstack([lifted, effort * difference @ difference, change * np.eye(samples)])
    wanted = np.concatenate([error + lifted @ feedforward, np.zeros(samples), change * feedforward])
    expected, *_ = np.linalg.lstsq(rows, wanted, rcond=None)
    result = np.fft.rfft(the_law.update(joint, error, feedforward, 0, TS))
    expected = np.fft.rfft(expected)
    np.testing.assert_allclose(result[inside], expected[inside], atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize('name', FOURIER)
def test_fourier_law_advances_a_harmonic(name):
    the_law, gains, n = law(name), GAINS['four_dof']['d3'], 12  # 35 Hz: full weight
    config, frequency = the_law.config, n / (N * TS)
    # the same in the time domain, run through a few cycles until the action is periodic: (7.33)
    psi = config.gain[0] * np.tile(np.roll(harmonic(n), -the_law.advance['d3']), 8)
    tau, integral, derivative, previous, expected = gains.derivative_filter, 0.0, 0.0, 0.0, []
    for value in psi:
        integral += gains.ki * TS * value
        derivative = (tau * derivative + gains.kd * (value - previous)) / (tau + TS)
        expected.append(gains.kp * value + config.integral * integral + config.derivative * derivative)
        previous = value
    expected = np.array(expected[-N:])
    expected = (expected - expected.mean()) * gains.notch.magnitude(
        frequency
    )  # without the start value of the integral
    action = the_law.config.gain[0] * the_law.action('d3', FREQUENCY)
    result = np.fft.irfft(action * np.fft.rfft(harmonic(n)), N)
    np.testing.assert_allclose(result, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize('name', law_names())
def test_mean_and_frequencies_above_the_band_are_not_learned(name):
    the_law = law(name)
    above = np.array([0.0, the_law.config.band.fall_to + 1, 400.0])
    assert not the_law.action('d1', above).any()
    error = 1e-6 * np.linspace(1, 3, N)  # a constant and a ramp, which closing removes
    result = the_law.update('d1', error, np.zeros(N), 0, TS)
    np.testing.assert_allclose(result, 0.0, atol=1e-12)  # V; rounding of 1e-5 V


@pytest.mark.parametrize('name', FOURIER)
def test_without_error_the_feedforward_only_decays(name):
    feedforward = np.linspace(-1, 1, N)
    the_law = law(name)
    result = the_law.update('d1', np.zeros(N), feedforward, 3, TS)
    np.testing.assert_allclose(result, the_law.config.forgetting * feedforward, atol=1e-14)


def test_gain_follows_its_schedule_and_its_last_value_stays():
    the_law = law('fourier_pid')
    size = [np.abs(the_law.update('d1', harmonic(12), np.zeros(N), i, TS)).max() for i in range(8)]
    np.testing.assert_allclose(np.array(size) / size[0], np.array([7, 7, 7, 7, 7, 5, 3, 3]) / 7)


def test_closing_removes_a_ramp_and_keeps_the_periodic_part():
    periodic = error_of_a_move(150.0)  # at rest around the boundary
    np.testing.assert_allclose(closed(periodic + 1e-6 * np.linspace(-4, 4, N), TS), periodic, atol=1e-12)
    np.testing.assert_allclose(closed(periodic + 3e-6, TS), periodic + 3e-6, atol=1e-12)


@pytest.mark.parametrize('name', law_names())
def test_feedforward_stays_within_the_voltage_limit(name):
    limit = MACHINES['four_dof'].voltage_limit
    # an acceleration, for which the basis law has a column too
    result = law(name).update('d1', 1e-3 * REFERENCE.acceleration[:, 0], np.zeros(N), 0, TS)
    assert np.abs(result).max() == limit


@pytest.mark.parametrize('name', law_names())
def test_update_is_a_pure_function(name):
    rng = np.random.default_rng(3)
    error, feedforward = 1e-6 * rng.standard_normal(N), rng.standard_normal(N)
    copies = error.copy(), feedforward.copy()
    the_law = law(name)
    first = the_law.update('d5', error, feedforward, 1, TS)
    the_law.update('d7', 1e-6 * feedforward, error, 0, TS)
    np.testing.assert_array_equal(the_law.update('d5', error, feedforward, 1, TS), first)
    np.testing.assert_array_equal(error, copies[0])
    np.testing.assert_array_equal(feedforward, copies[1])


def test_unknown_law_is_refused_with_the_known_ones():
    with pytest.raises(LearningError, match=r"'magic' is unknown; known: \['none', 'basis', 'fourier', "):
        law('magic')


def test_law_for_computed_torque_is_refused():
    machine = MACHINES['planar']
    with pytest.raises(LearningError, match='d1 has TorqueGains; only controllers of single axes learn'):
        untested_law('inverse', machine, load_torque_control(machine))


GOOD = {'joint': 'd1', 'error': np.zeros(N), 'feedforward': np.zeros(N), 'iteration': 0, 'sample_time': TS}


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'joint': 'd2'}, "joint 'd2' is unknown; known: "),
        ({'error': np.full(N, np.nan)}, 'd1: error is nan at sample 0'),
        ({'feedforward': np.append(np.zeros(N - 1), np.inf)}, 'd1: feedforward is inf at sample 679'),
        ({'error': np.zeros(N - 1)}, 'error has 679 samples, feedforward 680'),
        ({'error': np.zeros(10), 'feedforward': np.zeros(10)}, r'error has shape \(10,\); expected \(N,\), N >= 1\d'),
        ({'error': np.zeros((N, 1))}, r'error has shape \(680, 1\)'),
        ({'iteration': -1}, 'iteration is -1'),
        ({'sample_time': 1e-3}, 'sample time is 0.001 s; expected 0.0005 s'),
    ],
)
@pytest.mark.parametrize('name', law_names())
def test_unfit_request_is_refused(name, change, reason):
    with pytest.raises(LearningError, match=reason):
        law(name).update(**{**GOOD, **change})


def test_band_out_of_order_is_refused():
    with pytest.raises(ValueError, match='rise_from < rise_to'):
        Band(rise_from=3.0, rise_to=2.0, fall_from=100.0, fall_to=120.0)


def test_learning_file_with_an_unknown_key_is_refused(tmp_path):
    path = tmp_path / 'fourier.yaml'
    path.write_text(find_config('learning', 'fourier').read_text() + 'notch: 5 Hz\n')
    with pytest.raises(ConfigError, match='notch'):
        load_config(path, FourierConfig)
