"""
Frequency response of the amplifiers' current loop (Fig. 6.10), by its equations and measured by swept sine.

The measurement uses the compiled current loop of the plant's tick. A generator replaces the held command, which changes
every 0.5 ms and would limit the sweep to 1 kHz.
"""

import math
from functools import partial

import numpy as np
from numba import njit
from scipy.optimize import brentq

from pkm_core.plant.arrays import AXIS_STATE, COMMON_PARAMETERS
from pkm_core.plant.build import drive_times
from pkm_core.plant.drive import current_loop_response
from pkm_core.plant.tick import mean_current
from pkm_core.plotting import new_figure, save

LOWEST, HIGHEST = 100.0, 10e3  # [Hz] of the thesis's sweep
AMPLITUDE = 1.25  # [A] at 1 V, as in the thesis; the loop is linear


@njit(cache=True, error_model='numpy')
def _follow(axis, common, commands, currents):
    """Fill `currents` with the mean current [A] over each step; `commands` [A] has one value per step."""
    for k in range(commands.size):
        axis[0].before = axis[0].demand
        axis[0].demand = commands[k]
        currents[k] = mean_current(axis[0], common[0], True, False)


def swept_sine(frequencies, drive):
    """
    Return the measured complex response current over command at `frequencies` (...,) [Hz].

    Each frequency is measured over two periods after the initial transient. The command is held over steps slightly
    longer than the delay. The effect of holding and averaging on a sine, a sinc each, is removed.

    Parameters
    ----------
    frequencies : array_like
        Frequencies [Hz].
    drive : truth.Drive
        Drive of `Plant.truth`.

    """
    step = drive.delay + 1e-6
    times = drive_times(drive, step)
    common = np.zeros(1, COMMON_PARAMETERS)
    for name, value in times.items():
        common[name] = value
    settled = math.ceil(30.0 * times['current_lag'] / step)
    responses = []
    for frequency in np.ravel(frequencies):
        phase = 2.0 * np.pi * frequency * step * np.arange(settled + math.ceil(2.0 / (frequency * step)))
        commands, currents = AMPLITUDE * np.cos(phase), np.empty_like(phase)
        _follow(np.zeros(1, AXIS_STATE), common, commands, currents)
        base = np.stack([np.cos(phase[settled:]), -np.sin(phase[settled:])], axis=1)
        real, imaginary = np.linalg.lstsq(base, currents[settled:], rcond=None)[0]
        responses.append(complex(real, imaginary) / (AMPLITUDE * np.sinc(frequency * step) ** 2))
    return np.reshape(responses, np.shape(frequencies))


def figures(drive):
    """Return {'equations', 'swept_sine'}: corner [Hz], phase at 1 kHz [deg], gain at 1 and 2 kHz over 100 Hz [dB]."""
    return {
        'equations': _figures(partial(current_loop_response, drive=drive)),
        'swept_sine': _figures(partial(swept_sine, drive=drive)),
    }


def _figures(response):
    lowest = abs(response(LOWEST))
    one, two = response(1e3), response(2e3)
    return {
        'corner_hz': brentq(lambda f: abs(response(f)) / lowest - math.sqrt(0.5), 1e3, 100e3, xtol=0.1),
        'phase_at_1_khz_deg': math.degrees(np.angle(one)),
        'gain_at_1_khz_db': 20.0 * math.log10(abs(one) / lowest),
        'gain_at_2_khz_db': 20.0 * math.log10(abs(two) / lowest),
    }


def sweep(drive, points=81):
    """Return (frequencies [Hz], response by the equations, measured response), (points,) each, 100 Hz to 10 kHz."""
    frequencies = np.geomspace(LOWEST, HIGHEST, points)
    return frequencies, current_loop_response(frequencies, drive), swept_sine(frequencies, drive)


def draw(folder, frequencies, equations, measured):
    """Draw gain relative to 100 Hz, and phase, into folder/drive_response.png; Fig. 6.10."""
    figure = new_figure(8.0, 6.0)
    gain, phase = figure.subplots(2, 1, sharex=True)
    for label, response, style in (
        ('equations (6.1)-(6.3)', equations, {'color': 'C0'}),
        ('swept sine', measured, {'color': 'C1', 'linestyle': '', 'marker': '.'}),
    ):
        gain.semilogx(frequencies, 20.0 * np.log10(np.abs(response / response[0])), label=label, **style)
        phase.semilogx(frequencies, np.degrees(np.unwrap(np.angle(response))), label=label, **style)
    gain.plot(7420.0, -3.01, 'kx', label='thesis')
    phase.plot(1000.0, -8.72, 'kx', label='thesis')
    gain.set(ylabel='current over command [dB]', title='current loop of the amplifier')
    phase.set(ylabel='phase [deg]', xlabel='frequency [Hz]')
    for axes in (gain, phase):
        axes.grid(which='both', alpha=0.3)
    gain.legend()
    return save(figure, folder, 'drive_response')
