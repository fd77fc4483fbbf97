"""Margins: of the configured loops, compared with python-control, and from measured responses."""

import json
from functools import cache
from pathlib import Path

import control
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from pkm_core.control.filters import Lag, Notch
from pkm_core.control.margins import (
    design_grid,
    measured_margins,
    perturbed_models,
    require_margins,
    require_stable,
    stability_margins,
    unit_circle,
    worst_margins,
)
from pkm_core.control.model import Forces, load_model
from pkm_core.control.robust import RobustGains, load_control
from pkm_core.control.systems import open_loop, plant_system
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.tuning.evaluation import COLUMNS, AxisFigures
from pkm_core.verbs.margins import margins as margins_verb

TS = 0.5e-3
DESIGNS = Path(__file__).parents[1] / 'designs'
DESIGNED = {  # gain margin [dB], phase margin [deg], Smax, crossover [Hz], slowest pole: from the code of the search
    ('four_dof', 'd1'): (9.362, 44.993, 1.7050, 59.81, 0.9769785),
    ('four_dof', 'd3'): (9.102, 45.014, 1.6955, 54.57, 0.9720361),
    ('four_dof', 'd5'): (9.486, 45.064, 1.6803, 56.99, 0.9781999),
    ('four_dof', 'd7'): (8.701, 45.084, 1.7749, 52.15, 0.9835998),
    ('planar', 'd1'): (9.163, 44.992, 1.6839, 60.39, 0.9774243),
    ('planar', 'd3'): (8.686, 45.054, 1.7387, 51.82, 0.9743400),
}
ALL_AXES = [*DESIGNED, ('xy_stage', 'x'), ('xy_stage', 'y')]


@cache
def axis(machine_name, joint):
    machine = load_machine(machine_name)
    return load_control(machine)[joint], load_model(machine)[joint]


def design(machine, joint):
    return load_control(load_machine(machine), DESIGNS / f'{machine}.yaml')[joint], axis(machine, joint)[1]


@pytest.mark.parametrize(('machine', 'joint'), ALL_AXES)
def test_configured_loop_keeps_its_margins(machine, joint):
    margins = stability_margins(*axis(machine, joint), TS)
    assert margins.gain_margin >= 8.5
    assert margins.phase_margin >= 45.0
    assert margins.peak_sensitivity <= 1.8
    assert margins.crossover >= 50.0
    worst = worst_margins(*axis(machine, joint), TS)
    assert worst.stable
    assert worst.gain_margin >= 6.0
    assert worst.phase_margin >= 38.0
    assert worst.peak_sensitivity <= 2.3


@pytest.mark.parametrize(('machine', 'joint'), DESIGNED)
def test_margins_equal_those_of_the_design_search(machine, joint):
    gain, phase, peak, crossover, pole = DESIGNED[machine, joint]
    margins = stability_margins(*design(machine, joint), TS)
    assert margins.gain_margin == pytest.approx(gain, abs=0.005)  # the search interpolated on a coarser grid
    assert margins.phase_margin == pytest.approx(phase, abs=0.02)
    assert margins.peak_sensitivity == pytest.approx(peak, abs=0.001)
    assert margins.crossover == pytest.approx(crossover, abs=0.02)
    assert margins.slowest_pole == pytest.approx(pole, abs=1e-6)


def test_gain_raised_by_its_margin_is_at_the_stability_limit():
    gains, model = axis('four_dof', 'd1')
    margin = stability_margins(gains, model, TS).gain_margin
    for decibel, stable in ((margin - 0.01, True), (margin + 0.01, False)):
        raised = model.model_copy(update={'gain': model.gain * 10 ** (decibel / 20)})
        assert (stability_margins(gains, raised, TS).slowest_pole < 1) is stable


def test_plant_is_the_continuous_model_with_1p5_samples_of_delay():
    _, model = axis('planar', 'd3')
    frequency = 20.0
    s = 2j * np.pi * frequency
    continuous = model.gain / (s * (s + model.viscosity)) / (1 + s / (2 * np.pi * model.current_loop))
    for mode in model.modes:
        wr, wa = 2 * np.pi * mode.resonance, 2 * np.pi * mode.antiresonance
        zeros = s**2 + 2 * mode.antiresonance_damping * wa * s + wa**2
        continuous *= (wr / wa) ** 2 * zeros / (s**2 + 2 * mode.resonance_damping * wr * s + wr**2)
    discrete = plant_system(model, TS)(np.exp(s * TS))
    # the hold differs from half a sample of delay by (w Ts)^2/24 = 1.6e-4, its images add the same again
    assert discrete == pytest.approx(continuous * np.exp(-1.5 * s * TS), rel=5e-4)


def test_open_loop_is_the_response_the_learning_laws_assume():
    gains, model = axis('four_dof', 'd7')
    z = np.exp(2j * np.pi * np.array([5.0, 60.0, 300.0]) * TS)
    filters = 1.0
    for b0, b1, b2, a1, a2 in (gains.lag.discrete(TS), gains.notch.discrete(TS)):
        filters = filters * (b0 + b1 / z + b2 / z**2) / (1 + a1 / z + a2 / z**2)
    expected = gains.pid_response(z, TS) * filters * plant_system(model, TS)(z)
    np.testing.assert_allclose(open_loop(gains, model, TS)(z), expected, rtol=1e-9)


@pytest.mark.parametrize(('machine', 'joint'), [('four_dof', 'd7'), ('planar', 'd3')])
def test_margins_are_those_of_python_control(machine, joint):
    gains, model = axis(machine, joint)
    margins, loop = stability_margins(gains, model, TS), open_loop(gains, model, TS)
    w = 2 * np.pi * design_grid(TS)[:-1]
    response = control.frd(loop.control(TS)(np.exp(1j * w * TS)), w, smooth=True)
    gain, phase, distance, _, crossover, _ = control.stability_margins(response, returnall=True)
    decibel = 20 * np.log10(gain)
    # python-control interpolates with splines, this code with lines between points 0.25 Hz apart
    assert margins.gain_margin == pytest.approx(decibel[decibel > 0].min(), abs=1e-3)
    assert margins.gain_reduction == pytest.approx(-decibel[decibel < 0].max(), abs=1e-2)  # near 10 Hz
    assert margins.phase_margin == pytest.approx(np.abs(phase).min(), abs=1e-2)
    assert margins.peak_sensitivity == pytest.approx(1 / distance.min(), abs=1e-4)
    assert margins.crossover == pytest.approx(crossover.max() / (2 * np.pi), abs=1e-3)
    assert margins.disk_margin == pytest.approx(float(control.disk_margins(loop.control(TS), w)[0]), abs=1e-6)
    closed = control.feedback(loop.control(TS), 1)
    assert margins.slowest_pole == pytest.approx(np.abs(closed.poles()).max(), abs=1e-9)
    at = 2 * np.pi * margins.bandwidth
    assert abs(1 - closed(np.exp(1j * at * TS))) == pytest.approx(1.0, abs=1e-4)
    at = 2 * np.pi * margins.bandwidth_3db
    assert abs(1 - closed(np.exp(1j * at * TS))) == pytest.approx(np.sqrt(0.5), abs=1e-4)
    at = 2 * np.pi * margins.tracking_bandwidth
    assert abs(closed(np.exp(1j * at * TS))) == pytest.approx(np.sqrt(0.5), abs=1e-4)


def test_plant_is_that_of_python_control():
    _, model = axis('planar', 'd3')
    s = control.tf('s')
    w = 2 * np.pi * model.current_loop
    plant = model.gain / (s * (s + model.viscosity)) * w / (s + w)
    for mode in model.modes:
        wr, wa = 2 * np.pi * mode.resonance, 2 * np.pi * mode.antiresonance
        zeros = s**2 + 2 * mode.antiresonance_damping * wa * s + wa**2
        plant = plant * (wr / wa) ** 2 * zeros / (s**2 + 2 * mode.resonance_damping * wr * s + wr**2)
    z = unit_circle([3.0, 60.0, 240.0, 700.0], TS)
    expected = control.sample_system(control.ss(plant), TS, 'zoh')(z) / z
    np.testing.assert_allclose(plant_system(model, TS)(z), expected, rtol=1e-6)  # polynomials of 7th degree lose digits


def test_measured_response_gives_the_margins_of_the_model():
    gains, model = axis('four_dof', 'd5')
    frequency = np.arange(20.0, 500.0, 0.5)
    z = unit_circle(frequency, TS)
    rng = np.random.default_rng(1)
    noise = 1 + 1e-3 * (rng.standard_normal(z.size) + 1j * rng.standard_normal(z.size))
    measured = measured_margins(frequency, gains.response(z, TS) * plant_system(model, TS)(z) * noise)
    margins = stability_margins(gains, model, TS)
    assert measured.gain_margin == pytest.approx(margins.gain_margin, abs=0.05)  # noise of 0.1 % is 0.01 dB, 0.06 deg
    assert measured.phase_margin == pytest.approx(margins.phase_margin, abs=0.3)
    assert measured.peak_sensitivity == pytest.approx(margins.peak_sensitivity, rel=0.005)
    assert measured.bandwidth == pytest.approx(margins.bandwidth, abs=0.3)
    assert np.isnan(measured.slowest_pole)
    assert not measured.stable


@pytest.mark.parametrize(
    ('frequency', 'loop', 'reason'),
    [
        ([1.0], [1.0], r'frequency \(1,\)'),
        ([1.0, 2.0], [1.0], r'loop \(1,\)'),
        ([2.0, 1.0], [1.0, 1.0], 'rising'),
        ([1.0, 2.0], [1.0, np.nan], 'finite'),
    ],
)
def test_unfit_response_is_refused(frequency, loop, reason):
    with pytest.raises(PkmError, match=reason):
        measured_margins(frequency, loop)


def test_perturbed_models_vary_gain_modes_and_signs_of_zeros():
    _, model = axis('planar', 'd3')
    models = perturbed_models(model)
    assert models[0] == model
    assert len(models) == len(set(models)) == 36
    assert {round(m.gain / model.gain, 9) for m in models} == {1.0, 0.8, 1.2}
    signs = {tuple(np.sign(mode.antiresonance_damping) for mode in m.modes) for m in models}
    assert signs == {(a, b) for a in (-1, 1) for b in (-1, 1)}
    shifts = {round(m.modes[1].resonance / model.modes[1].resonance, 9) for m in models}
    assert shifts == {1.0, 0.95, 1.05}


def random_gains(rng, model):
    kd = 2 * np.pi * rng.uniform(20, 150) / model.gain
    kp = 2 * np.pi * rng.uniform(5, 80) * kd
    return RobustGains(
        kp=kp,
        ki=2 * np.pi * rng.uniform(1, 40) * kp,
        kd=kd,
        derivative_filter=rng.uniform(1e-5, 5e-4),
        lag=Lag(pole=300.0, zero=rng.uniform(200, 600), dc_gain=1.0),
        notch=Notch(centre=rng.uniform(200, 500), width=rng.uniform(30, 400), attenuation=rng.uniform(1, 25)),
    )


@pytest.mark.parametrize('viscosity', [20.0, 0.0])
def test_stability_by_nyquist_curve_and_by_poles_agree(viscosity):
    rng = np.random.default_rng(3)
    model = axis('four_dof', 'd3')[1].model_copy(update={'viscosity': viscosity})
    judge = AxisFigures(model, TS, bandwidth=45.0, resonances_from=150.0)
    verdicts = []
    for _ in range(60):
        gains = random_gains(rng, model)
        figures = dict(zip(COLUMNS, judge(gains), strict=True))
        margins = stability_margins(gains, model, TS)
        verdicts.append(margins.stable)
        if margins.peak_sensitivity < 50:  # within 0.2 dB of the limit the coarser grid may be wrong
            assert bool(abs(figures['end_angle']) < 1) is margins.stable
        if margins.stable and margins.peak_sensitivity < 3:
            assert figures['gain_margin'] == pytest.approx(margins.gain_margin, abs=0.02)
            assert figures['phase_margin'] == pytest.approx(margins.phase_margin, abs=0.1)
    assert 10 < sum(verdicts) < 50


@pytest.mark.parametrize(('machine', 'joint'), DESIGNED)
def test_figures_of_the_search_are_the_margins(machine, joint):
    gains, model = axis(machine, joint)
    figures = dict(zip(COLUMNS, AxisFigures(model, TS, bandwidth=45.0, resonances_from=150.0)(gains), strict=True))
    margins, worst = stability_margins(gains, model, TS), worst_margins(gains, model, TS)
    for name, tolerance in (('gain_margin', 0.01), ('phase_margin', 0.05), ('peak_sensitivity', 0.005)):
        assert figures[name] == pytest.approx(getattr(margins, name), abs=tolerance)  # of the coarser grid
        assert figures[f'worst_{name}'] == pytest.approx(getattr(worst, name), abs=tolerance)
    assert figures['unstable'] == 0


def test_unstable_gains_are_refused_with_their_margin():
    gains, model = design('four_dof', 'd1')
    loud = gains.model_copy(update={name: 4 * getattr(gains, name) for name in ('kp', 'ki', 'kd')})
    # 12.04 dB up from a margin of 9.36 dB
    with pytest.raises(PkmError, match=r'd1: the loop is unstable: slowest pole .* below 1, gain margin -2\.7 dB'):
        require_stable('d1', loud, model, TS)
    require_stable('d1', gains, model, TS)


@pytest.mark.parametrize(
    ('changed', 'reason'),
    [
        ({'kp': 60000.0}, r'd3: the loop is unstable: .* gain margin -\d+\.\d dB'),
        ({'kd': 80.0}, r'd3: the loop has gain margin \d\.\d dB, allowed from 6'),
        ({'kp': 1500.0}, r'd3: the loop has gain reduction \d\.\d dB, allowed from 6'),
        ({'kp': 10000.0}, r'd3: the loop has phase margin 2\d\.\d deg, allowed from 30'),
    ],
)
def test_gains_with_too_small_margins_are_refused_with_values(changed, reason):
    gains, model = axis('four_dof', 'd3')
    require_margins('d3', gains, model, TS, gain_margin=6.0, phase_margin=30.0)
    with pytest.raises(PkmError, match=reason):
        require_margins('d3', gains.model_copy(update=changed), model, TS, gain_margin=6.0, phase_margin=30.0)


def test_margins_verb_writes_figures_and_pictures(tmp_path):
    app = typer.Typer()
    app.command()(margins_verb)
    out = ['--out', str(tmp_path), '--json', str(tmp_path / 'margins.json'), '--overwrite']
    for controller in ('robust', 'computed_torque'):
        result = CliRunner().invoke(app, ['--machine', 'xy_stage', '--controller', controller, *out])
        assert result.exit_code == 0, result.output
        figures = json.loads((tmp_path / 'margins.json').read_text())
        assert figures['axes']['y']['nominal']['gain_margin'] > 8.5
        assert figures['axes']['y']['worst']['gain_margin'] > 6.0
    limits = figures['natural_frequency_limits_Hz']['x']
    assert limits['with modes']['stable'] < limits['rigid']['stable']
    assert {path.name for path in tmp_path.glob('*.png')} == {'margins_x.png', 'margins_y.png', 'torque_limits.png'}


def test_guide_at_rest_is_among_the_perturbed_models():
    """Without identified friction the figures do not change; a slow stiff loop loses phase on the spring."""
    gains, model = axis('planar', 'd3')
    known = model.model_copy(update={'forces': Forces(coulomb=0.09, slip=10e-6, coupling=1.0)})
    assert worst_margins(gains, known, TS).phase_margin < worst_margins(gains, model, TS).phase_margin - 3
    stuck = plant_system(known, TS, stuck=True)
    assert float(stuck(np.array([1.0 + 0j]))[0].real) == pytest.approx(10e-6 / 0.09, rel=1e-6)  # its spring [m/V]
    figures = AxisFigures(known, TS, bandwidth=45.0, resonances_from=150.0)(gains)
    searched = dict(zip(COLUMNS, figures, strict=True))
    worst = worst_margins(gains, known, TS)
    assert searched['unstable'] == 0
    assert searched['worst_phase_margin'] == pytest.approx(worst.phase_margin, abs=0.5)  # the grid is coarser
    assert searched['worst_peak_sensitivity'] == pytest.approx(worst.peak_sensitivity, rel=0.01)
