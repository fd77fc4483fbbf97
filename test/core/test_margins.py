"""The configured loops keep the promised margins on the models they were designed for."""

import numpy as np
import pytest

from pkm_core.control.margins import open_loop, plant_system, stability_margins
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.machines import load_machine

TS = 0.5e-3
DESIGNED = {  # gain margin [dB], phase margin [deg], Smax, crossover [Hz], slowest pole: from the search's own code
    ('four_dof', 'd1'): (9.362, 44.993, 1.7050, 59.81, 0.9769785),
    ('four_dof', 'd3'): (9.102, 45.014, 1.6955, 54.57, 0.9720361),
    ('four_dof', 'd5'): (9.486, 45.064, 1.6803, 56.99, 0.9781999),
    ('four_dof', 'd7'): (8.701, 45.084, 1.7749, 52.15, 0.9835998),
    ('planar', 'd1'): (9.163, 44.992, 1.6839, 60.39, 0.9774243),
    ('planar', 'd3'): (8.686, 45.054, 1.7387, 51.82, 0.9743400),
}


def axis(machine, joint):
    machine = load_machine(machine)
    return load_control(machine)[joint], load_model(machine)[joint]


@pytest.mark.parametrize(('machine', 'joint'), DESIGNED)
def test_configured_loop_keeps_its_margins(machine, joint):
    margins = stability_margins(*axis(machine, joint), TS)
    assert margins.gain_margin >= 8.5
    assert margins.phase_margin >= 44.9
    assert margins.peak_sensitivity <= 1.8
    assert margins.crossover >= 50.0


@pytest.mark.parametrize(('machine', 'joint'), DESIGNED)
def test_margins_equal_those_of_the_design_search(machine, joint):
    gain, phase, peak, crossover, pole = DESIGNED[machine, joint]
    margins = stability_margins(*axis(machine, joint), TS)
    assert margins.gain_margin == pytest.approx(gain, abs=0.005)  # the search interpolated on a coarser grid
    assert margins.phase_margin == pytest.approx(phase, abs=0.02)
    assert margins.peak_sensitivity == pytest.approx(peak, abs=0.001)
    assert margins.crossover == pytest.approx(crossover, abs=0.02)
    assert margins.slowest_pole == pytest.approx(pole, abs=1e-6)


def test_raising_the_gain_by_the_gain_margin_reaches_the_limit_of_stability():
    gains, model = axis('four_dof', 'd1')
    margin = stability_margins(gains, model, TS).gain_margin
    for decibel, stable in ((margin - 0.01, True), (margin + 0.01, False)):
        raised = model.model_copy(update={'gain': model.gain * 10 ** (decibel / 20)})
        assert (stability_margins(gains, raised, TS).slowest_pole < 1) is stable


def test_plant_is_the_continuous_model_behind_one_and_a_half_samples():
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
