"""The controller of one axis against a reference made of scipy's filters, and its behaviour at the limits."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pkm_core.config import find_config
from pkm_core.control.margins import plant_system
from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController, feedforward_gains, load_control
from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine

TS = 0.5e-3
LIMIT = 10.0
MACHINE = load_machine('four_dof')
GAINS = load_control(MACHINE)['d1']
MODEL = load_model(MACHINE)['d1']


def controller(gains=GAINS, limit=LIMIT):
    return RobustController(gains, MODEL, TS, limit)


def load(controller, position, learned=None):
    rest = np.zeros(len(position))
    controller.load(position, rest, rest, rest, rest if learned is None else learned)


def run(controller, measured):
    return np.array([controller.update(index, value) for index, value in enumerate(measured)]).T


def reference_voltage(gains, error, feedforward):
    tau = gains.derivative_filter
    previous = np.concatenate([error[:1], error[:-1]])  # the first difference is zero
    signal = gains.kp * error + lfilter([gains.ki * TS], [1, -1], error) + feedforward
    signal = signal + lfilter([gains.kd / (tau + TS)], [1, -tau / (tau + TS)], error - previous)
    for b0, b1, b2, a1, a2 in (gains.lag.discrete(TS), gains.notch.discrete(TS)):
        signal = lfilter([b0, b1, b2], [1, a1, a2], signal)
    return signal


def test_update_equals_the_law_written_with_scipy_filters():
    rng = np.random.default_rng(1)
    position, measured = 0.08 + 1e-4 * rng.standard_normal((2, 500))
    velocity, acceleration, jerk, learned = rng.standard_normal((4, 500)) * [[0.1], [8.0], [800.0], [0.2]]
    velocity[0] = acceleration[0] = jerk[0] = learned[0] = 0.0  # a cycle begins at rest
    axis = controller(limit=1e3)
    axis.load(position, velocity, acceleration, jerk, learned)
    voltage, error = run(axis, measured)
    kv, ka, kj = feedforward_gains(GAINS, MODEL, TS)
    feedforward = kv * velocity + ka * acceleration + kj * jerk + learned
    np.testing.assert_array_equal(error, position - measured)
    expected = reference_voltage(GAINS, position - measured, feedforward)
    np.testing.assert_allclose(voltage, expected, rtol=1e-9, atol=1e-9)


def test_slider_behind_its_reference_is_pushed_forward():
    axis = controller()
    load(axis, [0.080])
    voltage, error = axis.update(0, 0.079)
    assert error == pytest.approx(1e-3, rel=1e-12)
    assert voltage > 0


def test_update_returns_python_floats():
    axis = controller()
    load(axis, [0.080])
    assert [type(value) for value in axis.update(0, 0.0799)] == [float, float]


def test_learned_voltage_reaches_the_output_through_filters_of_unit_gain():
    axis = controller()
    load(axis, np.full(200, 0.08), learned=np.repeat([0.0, 0.5], 100))
    voltage, _ = run(axis, np.full(200, 0.08))
    assert voltage[99] == 0.0
    assert 0.0 < voltage[100] < 0.45
    assert voltage[-1] == pytest.approx(0.5, rel=1e-9)


def test_feedforward_inverts_the_plant_for_slow_motion():
    s = 2j * np.pi * 3.0
    z = np.exp(s * TS)
    kv, ka, kj = feedforward_gains(GAINS, MODEL, TS)
    filters = 1.0
    for b0, b1, b2, a1, a2 in (GAINS.lag.discrete(TS), GAINS.notch.discrete(TS)):
        filters *= (b0 + b1 / z + b2 / z**2) / (1 + a1 / z + a2 / z**2)
    whole = (kv * s + ka * s**2 + kj * s**3) * filters * plant_system(MODEL, TS)(z)
    # what remains is of second order in s dl (0.018) and in the first mode (3/238)
    assert whole == pytest.approx(1.0, abs=5e-4)


def test_voltage_stays_at_the_limit_and_the_integrator_does_not_wind_up():
    axis = controller()
    samples = 2000
    load(axis, np.full(samples + 60, 0.08))
    held, _ = run(axis, np.full(samples, 0.07))
    assert held.max() == LIMIT
    released = [axis.update(samples + index, 0.08)[0] for index in range(60)]
    # a second of 10 mm error would have stored 6000 V; without it only the filters (3 ms) have to run out
    assert max(np.abs(released[20:])) < 0.1 * LIMIT


def test_integrator_leaves_the_limit_as_soon_as_the_error_turns():
    axis = controller()
    load(axis, np.full(400, 0.08))
    measured = np.concatenate([np.full(200, 0.07), np.full(200, 0.0801)])
    voltage, _ = run(axis, measured)
    assert (voltage[210:] < 0).all()


def test_next_cycle_continues_without_a_jump():
    rng = np.random.default_rng(2)
    measured = 0.08 + 1e-6 * rng.standard_normal(300)
    whole, halves = controller(), controller()
    load(whole, np.full(300, 0.08))
    expected, _ = run(whole, measured)
    load(halves, np.full(150, 0.08))
    first, _ = run(halves, measured[:150])
    load(halves, np.full(150, 0.08))
    second, _ = run(halves, measured[150:])
    np.testing.assert_array_equal(np.concatenate([first, second]), expected)


def test_another_level_of_feedforward_does_not_move_a_resting_axis():
    measured = 0.08 + 1e-6 * np.random.default_rng(2).standard_normal(300)
    changing, steady = controller(), controller()
    load(changing, np.full(150, 0.08), learned=np.full(150, 0.1))
    first, _ = run(changing, measured[:150])
    load(changing, np.full(150, 0.08), learned=np.full(150, -0.4))
    second, _ = run(changing, measured[150:])
    load(steady, np.full(300, 0.08))
    np.testing.assert_allclose(np.concatenate([first, second]), run(steady, measured)[0], atol=1e-12)


def test_reset_forgets_the_past():
    axis, fresh = controller(), controller()
    load(axis, np.full(50, 0.08))
    run(axis, np.full(50, 0.0795))
    axis.reset()
    for each in (axis, fresh):
        load(each, np.full(50, 0.08))
    np.testing.assert_array_equal(run(axis, np.full(50, 0.0799)), run(fresh, np.full(50, 0.0799)))


@pytest.mark.parametrize('measured', [np.nan, np.inf, -np.inf])
def test_measurement_that_is_not_finite_is_refused_and_changes_nothing(measured):
    axis, undisturbed = controller(), controller()
    for each in (axis, undisturbed):
        load(each, np.full(3, 0.08))
        each.update(0, 0.0799)
    with pytest.raises(PkmError, match='sample 1: measured position is'):
        axis.update(1, measured)
    assert axis.update(1, 0.0799) == undisturbed.update(1, 0.0799)


@pytest.mark.parametrize('index', [-1, 3])
def test_sample_outside_the_cycle_is_refused(index):
    axis = controller()
    load(axis, np.full(3, 0.08))
    with pytest.raises(PkmError, match=f'sample {index}: the loaded cycle has 3 samples'):
        axis.update(index, 0.08)


def test_update_before_load_is_refused():
    with pytest.raises(PkmError, match='the loaded cycle has 0 samples'):
        controller().update(0, 0.08)


@pytest.mark.parametrize(
    ('learned', 'reason'),
    [(np.zeros(2), 'learned has shape'), (np.array([0.0, np.nan, 0.0]), 'learned is nan at sample 1')],
)
def test_unfit_cycle_is_refused_and_the_loaded_one_stays(learned, reason):
    axis = controller()
    load(axis, np.full(3, 0.08))
    with pytest.raises(PkmError, match=reason):
        load(axis, np.full(3, 0.09), learned)
    assert axis.update(0, 0.08)[1] == 0.0


def test_gains_for_other_joints_are_refused(tmp_path):
    path = tmp_path / 'control.yaml'
    path.write_text(find_config('control', 'four_dof').read_text().replace('  d7:', '  d9:'))
    with pytest.raises(ConfigError, match=r"joints are \['d1', 'd3', 'd5', 'd9'\]; four_dof has"):
        load_control(MACHINE, path)
