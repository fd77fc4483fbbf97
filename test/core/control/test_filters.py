"""The discrete filters are those of the design and agree with their physical parameters."""

from pathlib import Path

import numpy as np
import pytest

from pkm_core.config import parse_config
from pkm_core.control.filters import Lag, Notch, low_frequency_delay
from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine

TS = 0.5e-3
DESIGNS = Path(__file__).parents[1] / 'designs'
DESIGNED = {  # coefficients used in the design search: b0 b1 b2 a1 a2 of lag, then of notch
    ('four_dof', 'd1'): (
        [0.97317657, -0.09446780, 0.0, -0.12129123, 0.0],
        [0.86234229, -0.57930730, 0.40616459, -0.57930730, 0.26850688],
    ),
    ('four_dof', 'd3'): (
        [0.98738210, -0.11374135, 0.0, -0.12635925, 0.0],
        [0.75961383, -0.38753990, 0.52124706, -0.38753990, 0.28086090],
    ),
    ('four_dof', 'd5'): (
        [0.99861256, -0.27847099, 0.0, -0.27985843, 0.0],
        [0.85278666, -0.71054975, 0.48194793, -0.71054975, 0.33473459],
    ),
    ('four_dof', 'd7'): (
        [0.98990689, -0.11725071, 0.0, -0.12734382, 0.0],
        [0.67315365, -0.55820645, 0.56237020, -0.55820645, 0.23552385],
    ),
    ('planar', 'd1'): (
        [0.99466471, -0.29395079, 0.0, -0.29928608, 0.0],
        [0.89419123, -0.67740828, 0.47479718, -0.67740828, 0.36898841],
    ),
    ('planar', 'd3'): (
        [0.98291502, -0.15460488, 0.0, -0.17168986, 0.0],
        [0.76234221, -0.40268390, 0.49018406, -0.40268390, 0.25252627],
    ),
}


def response(coefficients, frequency):
    b0, b1, b2, a1, a2 = coefficients
    z = np.exp(2j * np.pi * frequency * TS)
    return (b0 + b1 / z + b2 / z**2) / (1 + a1 / z + a2 / z**2)


@pytest.mark.parametrize(('machine', 'joint'), DESIGNED)
def test_filters_are_those_used_in_the_design_search(machine, joint):
    gains = load_control(load_machine(machine), DESIGNS / f'{machine}.yaml')[joint]
    lag, notch = DESIGNED[machine, joint]
    np.testing.assert_allclose(gains.lag.discrete(TS), lag, atol=1e-6)
    np.testing.assert_allclose(gains.notch.discrete(TS), notch, atol=1e-6)


def test_notch_attenuates_at_its_centre_and_passes_the_ends():
    notch = Notch(centre=440.0, width=120.0, attenuation=20.0)
    at = np.array([0.0, 440.0, 1000.0])
    np.testing.assert_allclose(np.abs(response(notch.discrete(TS), at)), [1.0, 0.1, 1.0], atol=1e-12)
    np.testing.assert_allclose(notch.magnitude(np.array([0.0, 440.0])), [1.0, 0.1], atol=1e-12)


def test_notch_is_half_its_depth_at_its_band_edges():
    # (7.23): where |s^2 + wr^2| = wb w the filter is (A + 1j)/(1 + 1j) or its mirror; edges wl wh = wr^2, wh - wl = wb
    notch = Notch(centre=400.0, width=150.0, attenuation=20.0)
    edges = np.sqrt(400.0**2 + 75.0**2) + np.array([-75.0, 75.0])
    np.testing.assert_allclose(notch.magnitude(edges), np.sqrt((0.1**2 + 1) / 2), rtol=1e-12)


def test_lag_has_its_pole_zero_and_gain():
    b0, b1, b2, a1, a2 = Lag(pole=300.0, zero=800.0, dc_gain=10.0).discrete(TS)
    assert -a1 == pytest.approx(np.exp(-2 * np.pi * 300.0 * TS), abs=1e-15)
    assert -b1 / b0 == pytest.approx(np.exp(-2 * np.pi * 800.0 * TS), abs=1e-15)
    assert (b0 + b1) / (1 + a1) == pytest.approx(10.0, rel=1e-12)
    assert (b2, a2) == (0.0, 0.0)


def test_low_frequency_delay_is_the_phase_slope():
    coefficients = Notch(centre=300.0, width=400.0, attenuation=12.0).discrete(TS)
    slope = -np.angle(response(coefficients, 0.1)) / (2 * np.pi * 0.1)
    assert low_frequency_delay(coefficients, TS) == pytest.approx(slope, rel=1e-5)  # phase is odd: error ~ (0.1/300)^2


@pytest.mark.parametrize('text', [4.1, '4.1', '4.1 Hz', '4..1 dB', 'nan dB', '-3 dB'])
def test_notch_refuses_an_attenuation_that_is_not_in_decibel(text):
    """Or is not positive."""
    with pytest.raises(ConfigError, match='attenuation'):
        parse_config({'centre': '300 Hz', 'width': '100 Hz', 'attenuation': text}, Notch, where='test.yaml')


def test_notch_refuses_a_centre_the_loop_cannot_have():
    with pytest.raises(ConfigError, match='centre is 1200 Hz; allowed below 1000 Hz'):
        Notch(centre=1200.0, width=100.0, attenuation=10.0).discrete(TS)
