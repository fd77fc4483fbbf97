"""The controller of one axis compared with a reference of scipy filters, and its behaviour at the limits."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pkm_core.config import find_config
from pkm_core.control.axis import feedforward_gains
from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController, load_control
from pkm_core.control.systems import open_loop, plant_system
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


def test_positive_error_gives_positive_voltage():
    axis = controller()
    load(axis, [0.080])
    voltage, error = axis.update(0, 0.079)
    assert error == pytest.approx(1e-3, rel=1e-12)
    assert voltage > 0


def test_update_returns_python_floats():
    axis = controller()
    load(axis, [0.080])
    assert [type(value) for value in axis.update(0, 0.0799)] == [float, float]


def test_learned_voltage_passes_filters_of_unit_gain_unchanged():
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


def test_voltage_saturates_without_integrator_windup():
    axis = controller()
    samples = 2000
    load(axis, np.full(samples + 60, 0.08))
    held, _ = run(axis, np.full(samples, 0.07))
    assert held.max() == LIMIT
    released = [axis.update(samples + index, 0.08)[0] for index in range(60)]
    # one second of 10 mm error would integrate to 6000 V; without windup only the filters (3 ms) have to settle
    assert max(np.abs(released[20:])) < 0.1 * LIMIT


def test_voltage_leaves_the_limit_when_the_error_reverses():
    axis = controller()
    load(axis, np.full(400, 0.08))
    measured = np.concatenate([np.full(200, 0.07), np.full(200, 0.0801)])
    voltage, _ = run(axis, measured)
    assert (voltage[210:] < 0).all()


def test_next_cycle_continues_without_a_voltage_step():
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


def test_new_level_of_feedforward_does_not_move_a_resting_axis():
    measured = 0.08 + 1e-6 * np.random.default_rng(2).standard_normal(300)
    changing, steady = controller(), controller()
    load(changing, np.full(150, 0.08), learned=np.full(150, 0.1))
    first, _ = run(changing, measured[:150])
    load(changing, np.full(150, 0.08), learned=np.full(150, -0.4))
    second, _ = run(changing, measured[150:])
    load(steady, np.full(300, 0.08))
    np.testing.assert_allclose(np.concatenate([first, second]), run(steady, measured)[0], atol=1e-12)


def test_reset_returns_to_the_initial_state():
    axis, fresh = controller(), controller()
    load(axis, np.full(50, 0.08))
    run(axis, np.full(50, 0.0795))
    axis.reset()
    for each in (axis, fresh):
        load(each, np.full(50, 0.08))
    np.testing.assert_array_equal(run(axis, np.full(50, 0.0799)), run(fresh, np.full(50, 0.0799)))


@pytest.mark.parametrize('measured', [np.nan, np.inf, -np.inf])
def test_measurement_that_is_not_finite_leaves_the_state(measured):
    """It is refused with the sample."""
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


def moving(axis, learned=0.1):
    """Load a sine of 1 mm at 5 Hz and return measured positions that follow it within some micrometres."""
    t, w, amplitude = np.arange(400) * TS, 2 * np.pi * 5.0, 1e-3
    sine, cosine = np.sin(w * t), np.cos(w * t)
    derivatives = 0.08 + amplitude * sine, amplitude * w * cosine, -amplitude * w**2 * sine, -amplitude * w**3 * cosine
    axis.load(*derivatives, learned * sine)
    return derivatives[0] + 5e-6 * np.sin(2 * np.pi * 30 * t)


SOFTER = GAINS.model_copy(
    update={
        'kp': 0.6 * GAINS.kp,
        'ki': 0.3 * GAINS.ki,
        'kd': 0.7 * GAINS.kd,
        'derivative_filter': 3e-4,
        'lag': GAINS.lag.model_copy(update={'pole': 300.0, 'zero': 500.0}),
        'notch': GAINS.notch.model_copy(update={'centre': 300.0, 'attenuation': 12.0}),
    }
)


def test_exchange_in_motion_keeps_the_voltage_continuous():
    changed, same = controller(), controller()
    measured = moving(changed)
    moving(same)
    for index in range(200):
        changed.update(index, measured[index])
        voltage, error = same.update(index, measured[index])
    changed.exchange(SOFTER)
    held = [same._reference[index] - error for index in (200, 201)]  # the error is constant
    new = [changed.update(200 + k, position)[0] for k, position in enumerate(held)]
    old = [same.update(200 + k, position)[0] for k, position in enumerate(held)]
    assert new[0] == pytest.approx(old[0], abs=1e-12)
    assert abs(old[0] - voltage) > 1e-3  # the axis is moving
    # from the second tick on integral, derivative and feedforward change
    assert new[1] == pytest.approx(old[1], abs=0.2 * abs(old[1] - old[0]) + 2e-3)


def test_exchange_at_rest_keeps_the_voltage_at_constant_error():
    axis = controller()
    load(axis, np.full(300, 0.08), learned=np.full(300, 0.4))
    before, _ = run(axis, np.full(150, 0.08))
    axis.exchange(SOFTER)
    after = [axis.update(index, 0.08)[0] for index in range(150, 300)]
    np.testing.assert_allclose(after, before[-1], atol=1e-12)


def test_exchange_for_the_same_gains_changes_nothing():
    changed, same = controller(), controller()
    measured = moving(changed)
    moving(same)
    for index in range(400):
        if index % 50 == 0:
            changed.exchange(GAINS)
        assert changed.update(index, measured[index]) == pytest.approx(same.update(index, measured[index]), abs=1e-10)


def test_exchange_may_move_gain_between_pid_and_lag():
    loud = GAINS.model_copy(
        update={
            **{name: getattr(GAINS, name) / 10 for name in ('kp', 'ki', 'kd')},
            'lag': GAINS.lag.model_copy(update={'dc_gain': 10.0}),
        }
    )
    changed, same = controller(), controller()
    measured = moving(changed, learned=0.0)  # it is added before the lag: with learned voltage the output would change
    moving(same, learned=0.0)
    for index in range(400):
        if index == 200:
            changed.exchange(loud)
        assert changed.update(index, measured[index]) == pytest.approx(same.update(index, measured[index]), abs=1e-10)


def closed_loop(axis, samples, exchange_at=None):
    """Return the errors of `axis` in a loop with its own model."""
    plant = plant_system(MODEL, TS)
    state = np.zeros((plant.B.size, 1))
    errors = []
    for index in range(samples):
        if index == exchange_at:
            axis.exchange(SOFTER)
        voltage, error = axis.update(index, 0.08 + float((plant.C @ state)[0, 0]))
        state = plant.A @ state + plant.B * voltage
        errors.append(error)
    return np.array(errors)


def test_exchange_in_motion_adds_no_error_to_that_of_new_gains():
    changed, softer = controller(), controller(SOFTER)
    for axis in (changed, softer):
        moving(axis)
    own = np.abs(closed_loop(softer, 400)[200:]).max()  # 17 um; the first 200 samples are the start of the sine
    assert np.abs(closed_loop(changed, 400, exchange_at=200)[200:]).max() < own


def test_exchange_for_unstable_gains_is_refused_with_the_margin():
    """The old gains stay in use."""
    changed, same = controller(), controller()
    measured = moving(changed)
    moving(same)
    loud = GAINS.model_copy(update={name: 4 * getattr(GAINS, name) for name in ('kp', 'ki', 'kd')})
    for index in range(100):
        if index == 50:
            with pytest.raises(PkmError, match=r'new gains: the loop is unstable: .*, gain margin -3\.0 dB'):
                changed.exchange(loud)
        assert changed.update(index, measured[index]) == same.update(index, measured[index])


def test_exchange_of_gains_updates_the_feedforward():
    axis = controller()
    measured = moving(axis)
    run(axis, measured)
    axis.exchange(SOFTER)
    assert axis.gains == SOFTER
    assert axis.feedforward_gains == feedforward_gains(SOFTER, MODEL, TS)


def test_unstable_gains_of_a_file_are_refused_with_margin(tmp_path):
    path = tmp_path / 'control.yaml'
    text = find_config('control', 'four_dof').read_text()
    path.write_text(text.replace('kd: 0.0425555 V s/mm', 'kd: 0.425555 V s/mm'))
    with pytest.raises(PkmError, match=r'control.yaml: d3: the loop is unstable: slowest pole .* gain margin -'):
        load_control(MACHINE, path)


def test_feedforward_does_not_depend_on_the_gain_of_the_lag():
    loud = GAINS.model_copy(update={'lag': GAINS.lag.model_copy(update={'dc_gain': 10.0})})
    np.testing.assert_allclose(feedforward_gains(loud, MODEL, TS), np.array(feedforward_gains(GAINS, MODEL, TS)) / 10)
    z = np.exp(2j * np.pi * 50.0 * TS)
    assert open_loop(loud, MODEL, TS)(z) == pytest.approx(10 * open_loop(GAINS, MODEL, TS)(z), rel=1e-9)


def test_exchange_of_the_model_updates_the_feedforward():
    machine = load_machine('planar')
    gains, model = load_control(machine)['d1'], load_model(machine)['d1']
    heavier = model.model_copy(update={'gain': 0.8 * model.gain})
    controller = RobustController(gains, model, machine.sample_time, machine.voltage_limit)
    controller.exchange(gains, heavier)
    assert controller.feedforward_gains == feedforward_gains(gains, heavier, machine.sample_time)
    with pytest.raises(PkmError, match='unstable'):
        controller.exchange(gains, model.model_copy(update={'gain': 5 * model.gain}))
    assert controller.feedforward_gains == feedforward_gains(gains, heavier, machine.sample_time)
