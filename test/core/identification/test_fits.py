"""Fits on axes with known models: exact without noise, unbiased in closed loop, with correct uncertainties."""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from pkm_core.control.model import AxisModel, Mode, load_model
from pkm_core.control.pid import Pid
from pkm_core.control.systems import plant_system
from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import AxisData
from pkm_core.identification.frequency_fit import Surroundings, fit_high_frequency
from pkm_core.identification.frequency_response import estimate_response
from pkm_core.identification.partial_fractions import PartialFractions, mode_rows
from pkm_core.identification.prediction import KnownDynamics, moving_stretches
from pkm_core.identification.prediction_error import fit_low_frequency
from pkm_core.machines import load_machine
from pkm_core.motion.profiles import unit_profile

TS = 0.5e-3
MODES = (Mode(resonance=240.0, resonance_damping=0.026, antiresonance=256.0, antiresonance_damping=-0.027),)
AXIS = AxisModel(gain=10.0, viscosity=20.0, current_loop=7420.0, modes=MODES)
RIGID = AXIS.model_copy(update={'modes': ()})
LAW = Pid(kp=4000.0, ki=2e5, kd=25.0, derivative_filter=2e-4)  # 45 deg of phase margin at 45 Hz
KNOWN = KnownDynamics(AXIS.current_loop, 0.0, mode_rows(MODES))
SURROUNDINGS = Surroundings(AXIS.viscosity, TS, AXIS.current_loop)


@njit(cache=True)
def _run(Ap, Bp, Cp, Ad, Bd, Cd, disturbance, seen, reference, ahead, law, position, voltage):
    x, d = np.zeros(len(Bp)), np.zeros(len(Bd))
    kp, step, carry, kick = law
    integral = slope = before = 0.0
    for k in range(len(reference)):
        position[k] = Cp @ x + Cd @ d + seen[k]
        error = reference[k] - position[k]
        integral += step * error
        slope = carry * slope + kick * (error - before)
        before = error
        voltage[k] = kp * error + integral + slope + ahead[k]
        x = Ap @ x + Bp * voltage[k]
        d = Ad @ d + Bd * disturbance[k]


def closed_loop(reference, model=AXIS, *, excitation=None, force=0.0, noise=0.0, seed=0):
    """
    Return the `AxisData` of a linear axis under LAW with feedforward.

    `force` is white noise on the slider [m/s^2], `noise` on the encoder [m].
    """
    draw, count = np.random.default_rng(seed), len(reference)
    pushed = model.model_copy(update={'gain': 1.0, 'current_loop': 1e6})
    matrices = []
    for system in (plant_system(model, TS), plant_system(pushed, TS)):
        matrices += [system.A, system.B.ravel(), system.C.ravel()]
    speed = np.gradient(reference, TS)
    ahead = (np.gradient(speed, TS) + model.viscosity * speed) / model.gain
    if excitation is not None:
        ahead = ahead + excitation
    law = (
        LAW.kp,
        LAW.ki * TS,
        LAW.derivative_filter / (LAW.derivative_filter + TS),
        LAW.kd / (LAW.derivative_filter + TS),
    )
    disturbance, seen = force * draw.standard_normal(count), noise * draw.standard_normal(count)
    position, voltage = np.zeros(count), np.zeros(count)
    _run(*matrices, disturbance, seen, reference, ahead, law, position, voltage)
    return AxisData('axis', TS, voltage, position, reference=reference, excitation=excitation)


def moves(count=8, length=10e-3, samples=140):
    """Return a reference of moves there and back, with rests."""
    shape = unit_profile('p7', np.arange(samples) / samples)[0]
    rest = np.zeros(60)
    there = np.concatenate([rest, length * shape, length + rest, length * (1 - shape), rest])
    return np.tile(there, count // 2)


def chirp(periods=16, count=1024, amplitude=1.0):
    s = np.arange(count) / count
    one = amplitude * np.sin(2 * np.pi * (41 * s + 0.5 * (256 - 41 + 1) * s * s))
    return np.concatenate([np.zeros(100), np.tile(one, periods), np.zeros(100)])


@pytest.mark.parametrize('name', ['planar', 'four_dof'])
def test_partial_fractions_equal_the_matrices_of_states(name):
    frequency = np.linspace(1.0, 999.0, 500)
    z = np.exp(2j * np.pi * frequency * TS)
    for model in load_model(load_machine(name)).values():
        axis = PartialFractions.of(model.viscosity, model.current_loop, mode_rows(model.modes))
        ours = model.gain * axis.sampled(z, TS) / z
        np.testing.assert_allclose(ours, plant_system(model, TS)(z), rtol=1e-9)


@pytest.mark.parametrize('delay', [0.0, 3e-6, 0.2e-3])
def test_step_and_sampled_response_agree_with_dead_time(delay):
    axis = PartialFractions.of(20.0, 7420.0, mode_rows(MODES))
    time = TS * np.arange(4001)
    pulse = np.diff(axis.step(time - delay), prepend=0.0)  # response to a voltage held for one sample
    speed = np.diff(pulse)  # settles, so its transform converges
    frequency = np.array([5.0, 80.0, 240.0, 700.0])
    z = np.exp(2j * np.pi * frequency * TS)
    transform = speed @ z ** -np.arange(1, 4001)[:, np.newaxis]
    np.testing.assert_allclose(transform, axis.sampled(z, TS, delay) * (1 - 1 / z), rtol=1e-6)


def test_stretches_are_the_moves_without_their_slow_ends():
    data = closed_loop(moves(4))
    stretches = moving_stretches(data)
    assert [stretch.direction for stretch in stretches] == [1, -1, 1, -1]
    for stretch in stretches:
        assert 100 < stretch.end - stretch.start < 130  # of 140


def test_moves_without_noise_give_gain_and_viscosity_exactly():
    fit = fit_low_frequency([closed_loop(moves())], KNOWN)
    assert fit.gain == pytest.approx(AXIS.gain, rel=1e-4)  # the modes are excited before a stretch begins
    assert fit.viscosity == pytest.approx(AXIS.viscosity, rel=1e-3)
    assert fit.fit_percent > 99.99
    assert not fit.warnings
    assert (fit.used, fit.held_out) == (4, 4)


def test_friction_and_offset_are_separated():
    data = closed_loop(moves())
    pushed = 0.04 * np.sign(np.gradient(data.reference)) + 0.01  # [V] spent on friction and a weight
    fit = fit_low_frequency([replace(data, voltage=data.voltage + np.roll(pushed, -1))], KNOWN)
    assert fit.friction == pytest.approx(0.04, abs=1e-4)
    assert fit.offset == pytest.approx(0.01, abs=1e-4)
    assert fit.gain == pytest.approx(AXIS.gain, rel=1e-3)


def test_gain_is_unbiased_in_closed_loop():
    """With short moves and large force noise, least squares is biased by -16 %; the instrument is not."""
    ours, plain = [], []
    for seed in range(12):
        data = closed_loop(moves(16, 1e-3), RIGID, force=4.0, seed=seed)
        known = KnownDynamics(RIGID.current_loop)
        ours.append(fit_low_frequency([data], known).gain / RIGID.gain - 1)
        where = tuple((stretch.start, stretch.end) for stretch in moving_stretches(data))
        plain.append(fit_low_frequency([replace(data, reference=None, moves=where)], known).gain / RIGID.gain - 1)
    assert abs(np.mean(ours)) < 2 * np.std(ours) / np.sqrt(12)
    assert np.mean(plain) < -6 * np.std(plain) / np.sqrt(12)  # -16 %, nine times its standard error
    assert abs(np.mean(ours)) < 0.25 * abs(np.mean(plain))


def test_stated_deviations_equal_those_of_repeated_fits():
    fits = [
        fit_low_frequency([closed_loop(moves(16), RIGID, force=0.3, noise=1e-6, seed=seed)], KnownDynamics(7420.0))
        for seed in range(16)
    ]
    pulls = [((fit.gain - 10) / fit.deviations[0], (fit.viscosity - 20) / fit.deviations[1]) for fit in fits]
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.6  # 32 pulls scatter by 12 %, few stretches add to that


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'position': np.zeros(0)}, 'axis: 0 samples; at least 1'),
        ({'voltage': np.zeros(3)}, r'axis: voltage has shape \(3,\); expected \(920,\)'),
        ({'voltage': np.full(920, np.nan)}, 'axis: voltage is nan at sample 0'),
    ],
)
def test_inconsistent_record_is_refused(change, reason):
    data = closed_loop(np.zeros(920))
    with pytest.raises(IdentificationError, match=reason):
        replace(data, **change)


def test_axis_at_rest_is_refused_with_numbers():
    data = closed_loop(np.zeros(500))
    with pytest.raises(IdentificationError, match=r'0 stretches of one-way motion over 40 samples; at least 2'):
        fit_low_frequency([data], KNOWN)


def test_axis_that_does_not_follow_its_reference_is_refused():
    data = closed_loop(moves())
    dead = replace(data, position=np.full(len(data.position), 0.05))
    for estimate in (lambda: fit_low_frequency([dead], KNOWN), lambda: estimate_response(dead)):
        with pytest.raises(
            IdentificationError, match=r'moved by 0 m where its reference moved by 0\.01 m; .* enabled$'
        ):
            estimate()


def test_excitation_of_an_axis_at_standstill_is_refused():
    volts = chirp()
    data = replace(closed_loop(np.zeros(len(volts)), excitation=volts), position=np.zeros(len(volts)))
    with pytest.raises(IdentificationError, match=r'does not respond to the excitation; .* enabled$'):
        estimate_response(data, (80.0, 495.0))


def test_response_of_noise_alone_is_refused_by_coherence():
    volts = chirp()
    data = closed_loop(np.zeros(len(volts)), excitation=volts)
    noise = 1e-7 * np.random.default_rng(1).standard_normal(len(volts))
    response = estimate_response(replace(data, position=noise), (80.0, 495.0))
    with pytest.raises(IdentificationError, match=r'coherence is below 0\.8 at half of the lines, lowest 0\.0'):
        fit_high_frequency([response], SURROUNDINGS, count=1)


@pytest.mark.parametrize('seed', range(12))
def test_moves_at_constant_speed_are_refused(seed):
    """Constant speed does not separate gain and viscosity, for any noise."""
    ramp = 1e-3 * TS * np.arange(1500)  # 1 mm/s
    data = closed_loop(np.concatenate([ramp, ramp[::-1]]), RIGID, noise=1e-7, seed=seed)
    with pytest.raises(IdentificationError, match=r'axis: the moves do not determine K and a.*; vary their speed'):
        fit_low_frequency([data], KnownDynamics(RIGID.current_loop))


def test_few_saturated_samples_are_counted_and_many_refused():
    fit = fit_low_frequency([replace(closed_loop(moves()), limit=1.9265)], KNOWN)
    assert any(text.endswith('samples of the moves are at the limit of 1.9265 V') for text in fit.warnings)
    with pytest.raises(IdentificationError, match=r'the drive is saturated: \d\d\.\d % .* at 1 V; allowed 1 %'):
        fit_low_frequency([replace(closed_loop(moves()), limit=1.0)], KNOWN)


def test_response_without_noise_is_that_of_the_plant():
    volts = chirp()
    response = estimate_response(closed_loop(np.zeros(len(volts)), excitation=volts), (80.0, 495.0))
    z = np.exp(2j * np.pi * response.frequency * TS)
    np.testing.assert_allclose(response.plant, plant_system(AXIS, TS)(z), rtol=1e-4)  # residue of the initial transient
    assert response.periodic
    assert response.coherence.min() > 0.9999
    fit = fit_high_frequency([response], SURROUNDINGS, count=1)
    np.testing.assert_allclose(fit.modes, mode_rows(MODES), rtol=1e-3)


def test_response_with_instrument_is_unbiased():
    """With encoder noise as large as the motion, S_yu/S_uu is biased towards -1/C in closed loop."""
    volts = chirp(periods=60, amplitude=0.2)
    data = closed_loop(np.zeros(len(volts)), RIGID, excitation=volts, noise=2e-6)
    errors = {}
    for name, each in (('instrument', data), ('direct', replace(data, excitation=None))):
        response = estimate_response(each, (80.0, 300.0))
        true = plant_system(RIGID, TS)(np.exp(2j * np.pi * response.frequency * TS))
        errors[name] = abs(np.mean(response.plant / true - 1))
        assert response.instrument == (name == 'instrument')
    assert errors['instrument'] < 0.06  # mean over 113 lines of deviation 0.17
    assert errors['direct'] > 0.3


def test_drift_of_a_jog_does_not_leak_into_the_response():
    volts = chirp(periods=4)
    jog = 15e-3 * TS * np.arange(len(volts))
    still = estimate_response(closed_loop(0 * jog, excitation=volts), (80.0, 495.0))
    moving = estimate_response(closed_loop(jog, excitation=volts), (80.0, 495.0))
    np.testing.assert_allclose(moving.plant[5:], still.plant[5:], rtol=2e-3)


def test_stated_deviation_of_the_response_covers_its_errors():
    volts = chirp(periods=6)
    pulls = []
    for seed in range(6):
        response = estimate_response(
            closed_loop(np.zeros(len(volts)), RIGID, excitation=volts, noise=3e-6, seed=seed), (100.0, 450.0)
        )
        z = np.exp(2j * np.pi * response.frequency * TS)
        pulls.append(np.abs(response.plant - plant_system(RIGID, TS)(z)) / response.deviation)
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.15)


def test_fit_finds_right_half_plane_zeros_without_a_prior():
    volts = chirp()
    response = estimate_response(closed_loop(np.zeros(len(volts)), excitation=volts, noise=1e-7), (80.0, 495.0))
    fit = fit_high_frequency([response], SURROUNDINGS, count=1)
    np.testing.assert_allclose(fit.modes[0], mode_rows(MODES)[0], rtol=5e-3)
    assert fit.gains[0] == pytest.approx(AXIS.gain, rel=2e-3)
    assert fit.misfit == pytest.approx(1.0, abs=0.4)
    pulls = (fit.modes[0] - mode_rows(MODES)[0]) / fit.deviations[0]
    assert np.abs(pulls).max() < 4


def test_too_few_modes_are_reported():
    two = AXIS.model_copy(
        update={
            'modes': (
                *MODES,
                Mode(resonance=400.0, resonance_damping=0.02, antiresonance=450.0, antiresonance_damping=0.03),
            )
        }
    )
    volts = chirp()
    response = estimate_response(closed_loop(np.zeros(len(volts)), two, excitation=volts, noise=1e-7), (80.0, 495.0))
    fit = fit_high_frequency([response], SURROUNDINGS, count=1)
    assert any('more modes may be needed' in text for text in fit.warnings)
    assert not any('more modes' in text for text in fit_high_frequency([response], SURROUNDINGS, count=2).warnings)


def test_lack_of_coherence_is_reported_with_numbers():
    volts = chirp(amplitude=0.2)
    response = estimate_response(closed_loop(np.zeros(len(volts)), excitation=volts, noise=1e-7), (80.0, 495.0))
    fit = fit_high_frequency([response], SURROUNDINGS, count=1)
    assert any('coherence is below 0.8 at' in text for text in fit.warnings)


@pytest.mark.parametrize(
    ('change', 'band', 'reason'),
    [
        ({}, (80.0, 1200.0), r'band 80 to 1200 Hz; expected 0 < from < to < 1000 Hz'),
        ({'excitation': np.zeros(16584)}, None, 'no excitation: it is zero at all 16584 samples'),
        (
            {'limit': 0.5},
            (80.0, 495.0),
            r'excitation is saturated: \d+\.\d % of the samples are at 0\.5 V; allowed 1 %',
        ),
    ],
)
def test_unusable_excitation_is_refused_with_numbers(change, band, reason):
    volts = chirp()
    data = closed_loop(np.zeros(len(volts)), excitation=volts)
    with pytest.raises(IdentificationError, match=reason):
        estimate_response(replace(data, **change), band)


def test_record_shorter_than_two_periods_is_refused():
    volts = chirp(periods=1)[:300]
    data = closed_loop(np.zeros(len(volts)), excitation=volts)
    with pytest.raises(IdentificationError, match=r'lasts for 199 samples, 0 segments of 256; at least 2'):
        estimate_response(data)


def test_excitation_without_a_period_is_windowed():
    draw = np.random.default_rng(1)
    volts = np.concatenate([np.zeros(10), draw.standard_normal(20000)])
    response = estimate_response(closed_loop(np.zeros(len(volts)), RIGID, excitation=volts), (80.0, 495.0))
    assert not response.periodic
    z = np.exp(2j * np.pi * response.frequency * TS)
    np.testing.assert_allclose(response.plant, plant_system(RIGID, TS)(z), rtol=0.05)  # leakage of a Hann window
