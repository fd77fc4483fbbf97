"""The learning laws: their arithmetic, their convergence on the model, and what they refuse."""

import itertools

import numpy as np
import pytest

from pkm_core.config import find_config, load_config
from pkm_core.control.margins import open_loop
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError, LearningError
from pkm_core.learning import make_law
from pkm_core.learning.fourier import Band, FourierConfig
from pkm_core.machines import load_machine

TS = 0.5e-3
N = 680
LAWS = ('fourier', 'fourier_pid')
MACHINES = {name: load_machine(name) for name in ('four_dof', 'planar')}
CONTROL = {name: load_control(machine) for name, machine in MACHINES.items()}
AXES = [(name, joint) for name, machine in MACHINES.items() for joint in machine.joints]


def law(name, machine='four_dof'):
    return make_law(name, MACHINES[machine], CONTROL[machine])


def harmonic(n):
    return 1e-6 * np.sin(2 * np.pi * n * np.arange(N) / N)


def perturbed(model):
    """Yield the model with gain +-20 %, resonances +-5 % and either sign of the zeros."""
    for gain, shift, sign in itertools.product((0.8, 1.0, 1.2), (0.95, 1.0, 1.05), (1, -1)):
        modes = tuple(
            mode.model_copy(
                update={
                    'resonance': mode.resonance * shift,
                    'antiresonance': mode.antiresonance * shift,
                    'antiresonance_damping': mode.antiresonance_damping * sign,
                }
            )
            for mode in model.modes
        )
        yield model.model_copy(update={'gain': model.gain * gain, 'modes': modes})


# the error changes by the factor lam - Gl HL HN z^m PID G a cycle, G = FL FN P/(1 + L) = L/(1 + L)/PID
@pytest.mark.parametrize('name', LAWS)
@pytest.mark.parametrize(('machine', 'joint'), AXES)
def test_law_converges_at_every_frequency_on_every_perturbed_model(name, machine, joint):
    gains, model = CONTROL[machine][joint], load_model(MACHINES[machine])[joint]
    the_law = law(name, machine)
    frequency = np.arange(1, 1000) * 0.5
    z = np.exp(2j * np.pi * frequency * TS)
    action = the_law.action(joint, frequency) / gains.pid_response(z, TS)
    for plant in perturbed(model):
        loop = open_loop(gains, plant, TS)(z)
        factor = np.abs(the_law.config.forgetting - the_law.config.gain[0] * action * loop / (1 + loop))
        # lam is the factor where nothing is learned; learning never makes it worse
        assert factor.max() <= the_law.config.forgetting + 1e-12, f'{frequency[factor.argmax()]} Hz'


@pytest.mark.parametrize(('name', 'updates', 'left'), [('fourier', 12, 0.25), ('fourier_pid', 1, 0.35)])
@pytest.mark.parametrize(('machine', 'joint'), AXES)
def test_error_of_a_move_shrinks_as_promised_on_the_model(name, updates, left, machine, joint):
    gains, model = CONTROL[machine][joint], load_model(MACHINES[machine])[joint]
    the_law = law(name, machine)
    frequency = np.arange(10.0, 60.0)  # Hz; where most of the error of a 70 ms move lies
    z = np.exp(2j * np.pi * frequency * TS)
    loop = open_loop(gains, model, TS)(z)
    action = the_law.action(joint, frequency) / gains.pid_response(z, TS) * loop / (1 + loop)
    assert (np.abs(the_law.config.forgetting - the_law.config.gain[0] * action) ** updates).max() < left


@pytest.mark.parametrize('name', LAWS)
def test_harmonic_passes_the_action_shifted_forward(name):
    the_law, gains, n = law(name), CONTROL['four_dof']['d3'], 12  # 35 Hz: full weight
    config, frequency = the_law.config, n / (N * TS)
    shift = round(config.advance / TS)
    # the same in the time domain, run through a few cycles until the action is periodic: (7.33)
    psi = config.gain[0] * np.tile(np.roll(harmonic(n), -shift), 8)
    tau, integral, derivative, previous, expected = gains.derivative_filter, 0.0, 0.0, 0.0, []
    for value in psi:
        integral += gains.ki * TS * value
        derivative = (tau * derivative + gains.kd * (value - previous)) / (tau + TS)
        expected.append(gains.kp * value + config.integral * integral + config.derivative * derivative)
        previous = value
    expected = np.array(expected[-N:])
    expected = (expected - expected.mean()) * gains.notch.magnitude(frequency)  # the integral's start value has no part
    result = the_law.update('d3', harmonic(n), np.zeros(N), 0, TS)
    np.testing.assert_allclose(result, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize('name', LAWS)
def test_mean_and_what_lies_above_the_band_are_not_learned(name):
    error = 1e-6 + harmonic(70)  # 206 Hz
    result = law(name).update('d1', error, np.zeros(N), 0, TS)
    np.testing.assert_allclose(result, 0.0, atol=1e-12)  # V; rounding of 1e-5 V


@pytest.mark.parametrize('name', LAWS)
def test_without_error_the_feedforward_is_only_forgotten(name):
    feedforward = np.linspace(-1, 1, N)
    the_law = law(name)
    result = the_law.update('d1', np.zeros(N), feedforward, 3, TS)
    np.testing.assert_allclose(result, the_law.config.forgetting * feedforward, rtol=1e-15)


def test_gain_follows_its_schedule_and_its_last_value_stays():
    the_law = law('fourier_pid')
    size = [np.abs(the_law.update('d1', harmonic(12), np.zeros(N), i, TS)).max() for i in range(8)]
    np.testing.assert_allclose(np.array(size) / size[0], np.array([7, 7, 7, 7, 7, 5, 3, 3]) / 7)


@pytest.mark.parametrize('name', LAWS)
def test_update_is_a_pure_function(name):
    rng = np.random.default_rng(3)
    error, feedforward = 1e-6 * rng.standard_normal(N), rng.standard_normal(N)
    copies = error.copy(), feedforward.copy()
    the_law = law(name)
    first = the_law.update('d5', error, feedforward, 1, TS)
    the_law.update('d7', feedforward, error, 0, TS)
    np.testing.assert_array_equal(the_law.update('d5', error, feedforward, 1, TS), first)
    np.testing.assert_array_equal(error, copies[0])
    np.testing.assert_array_equal(feedforward, copies[1])


def test_unknown_law_is_refused_with_the_known_ones():
    with pytest.raises(LearningError, match=r"'magic' is unknown; known: \['fourier', 'fourier_pid'"):
        law('magic')


GOOD = {'joint': 'd1', 'error': np.zeros(N), 'feedforward': np.zeros(N), 'iteration': 0, 'sample_time': TS}


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'joint': 'd2'}, "joint 'd2' is unknown; known: "),
        ({'error': np.full(N, np.nan)}, 'd1: error is nan at sample 0'),
        ({'feedforward': np.append(np.zeros(N - 1), np.inf)}, 'd1: feedforward is inf at sample 679'),
        ({'error': np.zeros(N - 1)}, 'error has 679 samples, feedforward 680'),
        ({'error': np.zeros(14), 'feedforward': np.zeros(14)}, r'error has shape \(14,\); expected \(N,\), N >= 15'),
        ({'error': np.zeros((N, 1))}, r'error has shape \(680, 1\)'),
        ({'iteration': -1}, 'iteration is -1'),
        ({'sample_time': 1e-3}, 'sample time is 0.001 s; expected 0.0005 s'),
    ],
)
@pytest.mark.parametrize('name', LAWS)
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
