"""Flexible modes: exact steps of H_i, its frequency response through the plant, position dependence."""

import shutil

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.machines import load_machine
from pkm_core.plant.modes import STEP_SIZE, blend_steps, mode_step, mode_steps
from pkm_core.plant.plant import Plant
from pkm_core.plant.truth import load_truth

H = 31.25e-6
MACHINES = ('four_dof', 'planar', 'xy_stage')


def response(modes, s):
    """Return H_i (7.20) at the complex frequencies `s`."""
    total = np.ones_like(s)
    for mode in modes:
        wr, wa = 2.0 * np.pi * mode.resonance, 2.0 * np.pi * mode.antiresonance
        total *= (wr / wa) ** 2 * (s**2 + 2.0 * mode.antiresonance_damping * wa * s + wa**2)
        total /= s**2 + 2.0 * mode.resonance_damping * wr * s + wr**2
    return total


def fitted(signal, frequency, step):
    """Return the complex amplitude of `signal` (T,) at `frequency` [Hz]; offset and drift are fitted too."""
    t = step * np.arange(signal.size)
    phase = 2.0 * np.pi * frequency * t
    base = np.stack([np.cos(phase), np.sin(phase), np.ones_like(t), t], axis=1)
    a, b, *_ = np.linalg.lstsq(base, signal, rcond=None)[0]
    return a - 1j * b


def axes_of(name):
    return load_truth(load_machine(name), 'nominal')[0].axes


@pytest.mark.parametrize(('name', 'joint'), [(name, joint) for name in MACHINES for joint in load_machine(name).joints])
def test_steps_have_the_response_of_the_identified_dynamics(name, joint):
    modes = axes_of(name)[joint].modes
    steps = mode_steps(modes, H)
    for frequency in (80.0, 235.0, 252.0, 380.0, 500.0):
        w = 2.0 * np.pi * frequency
        state = np.zeros((len(modes), 2))
        signal = []
        for k in range(round(0.6 / H)):
            speed = -w * np.sin(w * k * H)  # of r = cos(w t)
            acceleration = (-w * np.sin(w * (k + 1) * H) - speed) / H  # mean, as the rigid machine is integrated
            for m in range(len(modes)):
                state[m] = mode_step(state[m, 0], state[m, 1], steps[m], speed, acceleration)
            signal.append(np.cos(w * (k + 1) * H) + state[:, 0].sum())
        signal = np.array(signal)[round(0.4 / H) :]  # 0.4 s: exp(-0.012 * 2 pi 240 * 0.4) = 7e-4 of the transient left
        found = fitted(signal, frequency, H) * np.exp(-1j * w * (H + round(0.4 / H) * H))
        expected = response(modes, np.array([1j * w]))[0]
        # 2e-3: that remainder and the acceleration's staircase, (w h)^2 / 12
        assert abs(found - expected) < 2e-3 * max(1.0, abs(expected))


def test_planar_d3_is_the_printed_transfer_function():
    s = 2j * np.pi * np.linspace(1.0, 600.0, 200)
    zeros = (s**2 - 88.36 * s + 2.584e6) * (s**2 - 841.0 * s + 4.821e7)
    poles = (s**2 + 79.18 * s + 2.286e6) * (s**2 + 133.9 * s + 7.567e6)
    printed = zeros / poles * (2.286e6 * 7.567e6) / (2.584e6 * 4.821e7)
    np.testing.assert_allclose(response(axes_of('planar')['d3'].modes, s), printed, rtol=1e-4)


@pytest.mark.parametrize(
    ('name', 'lowest', 'highest'), [('four_dof', 355, 446), ('planar', 371, 438), ('xy_stage', 220, 252)]
)
def test_main_resonances_are_those_of_the_thesis(name, lowest, highest):
    main = [axis.modes[-1].resonance for axis in axes_of(name).values()]
    assert min(main) == pytest.approx(lowest, abs=0.5)
    assert max(main) == pytest.approx(highest, abs=0.5)


def test_modes_do_not_change_the_settled_position():
    modes = axes_of('planar')['d3'].modes
    steps = mode_steps(modes, H)
    state = np.array([[3e-6, 0.0], [-1e-6, 0.0]])
    for _ in range(round(1.0 / H)):
        for m in range(2):
            state[m] = mode_step(state[m, 0], state[m, 1], steps[m], 0.0, 0.0)
    assert np.abs(state).max() < 1e-12


def test_blend_equals_the_table_at_its_points_and_is_bounded():
    table = np.random.default_rng(1).normal(size=(5, 2, STEP_SIZE))
    steps = np.zeros((2, STEP_SIZE))
    for place, expected in ((0.0, table[0]), (0.5, table[2]), (1.0, table[4]), (-3.0, table[0]), (7.0, table[4])):
        blend_steps(table, place, steps)
        np.testing.assert_allclose(steps, expected, atol=1e-14)
    blend_steps(table, 0.375, steps)
    np.testing.assert_allclose(steps, 0.5 * (table[1] + table[2]), atol=1e-14)


@pytest.fixture
def clean_stage(tmp_path):
    """Return a function: an XY stage, ideal except for its modes, shifted by `shift` over the travel."""

    def make(shift):
        shutil.copytree(Configuration.of_environment().folder, tmp_path / 'config', dirs_exist_ok=True)
        path = tmp_path / 'config' / 'truth' / 'xy_stage.yaml'
        head, ideal, rest = path.read_text().partition('  ideal:')
        assert 'mode_shift: 0 %' in rest
        rest = rest.replace('modes: false', 'modes: true', 1).replace('mode_shift: 0 %', f'mode_shift: {shift}', 1)
        path.write_text(head + ideal + rest)
        return Plant(load_machine('xy_stage', Configuration(tmp_path / 'config')), 1, 'ideal')

    return make


def swept(plant, frequency, amplitude=1.0, seconds=0.5):
    """Return true position over volts of x at `frequency` [Hz], from the last 0.2 s."""
    tick = plant.machine.sample_time
    w = 2.0 * np.pi * frequency
    volts, positions = [], []
    for k in range(round(seconds / tick)):
        volts.append(amplitude * np.cos(w * k * tick))
        positions.append(plant.truth.q[0])
        plant.tick([volts[-1], 0.0])
    late = round((seconds - 0.2) / tick)
    return fitted(np.array(positions)[late:], frequency, tick) / fitted(np.array(volts)[late:], frequency, tick)


@pytest.mark.parametrize('frequency', [90.0, 200.0, 220.0, 238.0, 400.0])
def test_plant_has_the_identified_frequency_response(frequency, clean_stage):
    """From volts to position, of an axis with modes."""
    plant = clean_stage('0 %')
    s = 2j * np.pi * frequency
    mass = 8.2023
    rigid = plant.machine.thrust_per_volt / (mass * s * (s + 10.0 * 8.2 / mass))
    hold = (1.0 - np.exp(-s * 0.5e-3)) / (s * 0.5e-3)
    drive = np.exp(-s * (0.5e-3 + 2.9e-6)) / (1.0 + s / (2.0 * np.pi * 7420.0))
    modes = load_truth(plant.machine, 'ideal')[0].axes['x'].modes
    expected = rigid * hold * drive * response(modes, np.array([s]))[0]
    # images of the held voltage at 2 kHz - f alias with (f / 2 kHz)^3; codes of 0.3 mV in 1 V
    assert abs(swept(plant, frequency) / expected - 1.0) < 0.025


def test_resonance_shifts_with_position_if_configured(clean_stage):
    grid = np.arange(200.0, 264.0, 4.0)

    def peak_near(ticks):
        peaks = []
        for frequency in grid:
            plant = clean_stage('20 %')
            for _ in range(ticks):
                plant.tick([2.0, 0.0])
            list(plant.brake(400))
            peaks.append(abs(swept(plant, frequency, 0.3, 0.4)) * frequency**2)
        return plant.truth.q[0], grid[np.argmax(peaks)]

    at_home, further = peak_near(0), peak_near(60)
    assert at_home[1] == pytest.approx(220.0, abs=4.0)
    assert further[0] > 30e-3
    # 20 % more at 40 mm, counted from the 20 mm of home; grid of 4 Hz
    assert further[1] == pytest.approx(220.0 * (1.0 + 0.2 * (further[0] - 20e-3) / 20e-3), abs=4.0)
