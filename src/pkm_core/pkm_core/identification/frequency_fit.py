"""
Least-squares fit of the high-frequency model H of (7.20) to a measured response; stable, in complex pairs.

The fitted response is that of the plant of the controller: K H wc/((s + wc) s (s + a)) with hold and computation,
sampled exactly. Every line is weighted by its own uncertainty. The initial modes come from the response itself.
Dampings of resonances are fitted as logarithms, which keeps them stable. Dampings of anti-resonances have either sign:
zeros may lie in the right half plane.

Responses at several positions are fitted together with common modes and one gain each, because the variation of
thrust along the magnets exceeds the scatter of the lines. The misfit shows whether the modes move with position.

A zero far above the band and a dead time turn the phase alike. The dead time is therefore a parameter with a prior:
its known value is one more measurement with its own uncertainty. This widens the covariance of such zeros correctly.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pkm_core.identification import IdentificationError
from pkm_core.identification.first_guess import guess_modes
from pkm_core.identification.partial_fractions import PartialFractions

_ZERO_SCALE = 10.0  # brings signed dampings (hundredths) to the size of the logarithms
# thresholds of warnings
COHERENT = 0.8
_CLEAN = 0.98  # coherence at which noise is a seventh of the response
MISFIT = 2.0
_POOR_FREQUENCY, _POOR_DAMPING = 0.01, 0.2  # relative standard deviations
_LINES, _WINDOWED_LINES = 3.0, 8.0  # least width of a resolved resonance [lines]


@dataclass(frozen=True)
class Surroundings:
    """The known dynamics around H."""

    viscosity: float  # a [1/s]
    sample_time: float  # [s]
    corner: float = np.inf  # [Hz] of the current loop
    delay: float = 0.0  # [s] dead time beyond the computation
    delay_deviation: float = 2e-6  # [s] its standard deviation
    computation: int = 1  # whole samples

    def response(self, frequency, gain, delay, modes):
        """Return P (F,) [m/V] at `frequency` (F,) [Hz] for a gain, a dead time [s] and modes (m, 4)."""
        z = np.exp(2j * np.pi * frequency * self.sample_time)
        axis = PartialFractions.of(self.viscosity, self.corner, modes)
        return gain * axis.sampled(z, self.sample_time, delay) / z**self.computation


@dataclass(frozen=True)
class HighFrequencyFit:
    """Fitted H; rows of `modes` are (resonance [Hz], damping, anti-resonance [Hz], damping), both ascending."""

    modes: np.ndarray  # (m, 4)
    covariance: np.ndarray  # (4 m, 4 m) of modes.ravel()
    gains: np.ndarray  # (responses,) K of each sweep [m/s^2/V]
    delay: float  # [s] dead time beyond the computation
    misfit: float  # mean squared error over that expected from the scatter of the measurement
    warnings: tuple[str, ...]

    @property
    def deviations(self):
        """Standard deviations of `modes`, (m, 4)."""
        return np.sqrt(np.diag(self.covariance)).reshape(-1, 4)


def fit_high_frequency(responses, known, count=2):
    """
    Return the `HighFrequencyFit` of `count` modes to `FrequencyResponse` objects with the `Surroundings` `known`.

    Raises
    ------
    IdentificationError
        If there are too few lines for the parameters, the coherence is low at half of them, or `count` resonances do
        not fit the responses.

    """
    from scipy.optimize import least_squares

    name, least = responses[0].name, 2 * count + 5
    lines = min(response.frequency.size for response in responses)
    if lines < least:
        raise IdentificationError(f'{name}: {lines} lines for {count} modes; at least {least} are needed')
    for response in responses:
        if np.median(response.coherence) < COHERENT:
            raise IdentificationError(
                f'{response.name}: coherence is below {COHERENT:g} at half of the lines, lowest '
                f'{response.coherence.min():.2f}; the response to the excitation is too weak: raise the amplitude or '
                f'the number of periods'
            )
    guesses = [_guess(response, known, count) for response in responses]
    which = np.repeat(np.arange(len(responses)), [response.frequency.size for response in responses])
    plant, deviation = (np.concatenate([getattr(each, part) for each in responses]) for part in ('plant', 'deviation'))
    grid, line = np.unique(np.concatenate([response.frequency for response in responses]), return_inverse=True)

    def errors(x):
        gains, delay, modes = _unpack(x, known, len(responses))
        off = plant - gains[which] * known.response(grid, 1.0, delay, modes)[line]
        off *= np.sqrt(2) / deviation  # real and imaginary part have half the variance each
        return np.concatenate([off.real, off.imag, x[len(gains) : len(gains) + 1]])  # last: the prior of the dead time

    found: Any = None  # there is at least one start
    starts = [_pack([gain for gain, _ in guesses], modes) for _, modes in guesses]
    for start in sorted(starts, key=lambda each: np.sum(errors(each) ** 2)):
        each = least_squares(errors, start, method='lm', x_scale='jac', max_nfev=2000)
        found = each if found is None or each.cost < found.cost else found
        misfit = 2 * found.cost / (found.fun.size - found.x.size)
        if misfit <= MISFIT:
            break
    gains, delay, modes = _unpack(found.x, known, len(responses))
    if not found.success or (modes[:, 1] >= 1).any():
        best = ', '.join(f'{f:.0f} Hz (damping {z:.2g})' for f, z in modes[:, :2])
        raise IdentificationError(
            f'{name}: {count} resonances do not fit the response; best fit: {best}, misfit {misfit:.1f} times the '
            f'scatter of the measurement'
        )
    scale = modes.copy()  # of logarithms
    scale[:, 3] = 1 / _ZERO_SCALE
    first = len(gains) + 1  # index of the modes in the vector of parameters
    covariance = np.linalg.pinv(found.jac.T @ found.jac)[first:, first:] * max(1.0, misfit)
    modes, covariance = _rising(modes, covariance * np.outer(scale, scale))
    deviations = np.sqrt(np.diag(covariance)).reshape(-1, 4)
    return HighFrequencyFit(
        modes, covariance, gains, delay, misfit, tuple(_warnings(responses, modes, deviations, misfit))
    )


def response_fit_percent(response, known, fit, gain):
    """Return 100 (1 - rms of (P_measured/P_model - 1)) over lines of coherence of at least _CLEAN; nan without any."""
    lines = response.coherence >= _CLEAN
    if not lines.any():
        return float('nan')
    model = known.response(response.frequency[lines], gain, fit.delay, fit.modes)
    return float(100 * (1 - np.sqrt(np.mean(np.abs(response.plant[lines] / model - 1) ** 2))))


def _guess(response, known, count):
    rigid = known.response(response.frequency, 1.0, known.delay, ())
    return guess_modes(response.frequency, response.plant / rigid, response.deviation / np.abs(rigid), count)


def _pack(gains, modes):
    """Return the vector of parameters: log gains, error of the known dead time over its deviation, modes."""
    rows = np.column_stack([np.log(modes[:, :3]), _ZERO_SCALE * modes[:, 3]])
    return np.concatenate([np.log(gains), [0.0], rows.ravel()])


def _unpack(x, known, count):
    """Return gains (count,), dead time and modes of the vector of parameters."""
    rows = x[count + 1 :].reshape(-1, 4)
    modes = np.column_stack([np.exp(np.clip(rows[:, :3], -20, 20)), rows[:, 3] / _ZERO_SCALE])
    return np.exp(x[:count]), float(known.delay + known.delay_deviation * x[count]), modes


def _rising(modes, covariance):
    """Return both with resonances ascending and, independently, anti-resonances ascending."""
    places = np.arange(modes.size).reshape(modes.shape)
    order = np.hstack([places[np.argsort(modes[:, 0]), :2], places[np.argsort(modes[:, 2]), 2:]])
    return modes.ravel()[order], covariance[np.ix_(order.ravel(), order.ravel())]


def _warnings(responses, modes, deviations, misfit):
    for response in responses:
        frequency, coherence = response.frequency, response.coherence
        poor = coherence < COHERENT
        if poor.any():
            yield (
                f'{response.name}: coherence is below {COHERENT:g} at {poor.sum()} of {poor.size} lines '
                f'({frequency[poor].min():.0f} to {frequency[poor].max():.0f} Hz), lowest {coherence.min():.2f}'
            )
    name, frequency = responses[0].name, responses[0].frequency
    if misfit > MISFIT:
        yield f'{name}: the misfit is {misfit:.1f} times the scatter; more modes may be needed'
    spacing = frequency[1] - frequency[0]
    needed = _LINES if responses[0].periodic else _WINDOWED_LINES
    for row, deviation in zip(modes, deviations, strict=True):
        for what, f, z, f_deviation, z_deviation in (
            ('resonance', *row[:2], *deviation[:2]),
            ('anti-resonance', *row[2:], *deviation[2:]),
        ):
            value = f'{what} at {f:.1f} +- {f_deviation:.1f} Hz (damping {z:.4f} +- {z_deviation:.4f})'
            if not frequency[0] <= f <= frequency[-1]:
                yield f'{name}: {value} lies outside the band of {frequency[0]:.0f} to {frequency[-1]:.0f} Hz'
            if f_deviation > _POOR_FREQUENCY * f or z_deviation > _POOR_DAMPING * abs(z):
                yield f'{name}: {value} is uncertain'
        if 2 * row[1] * row[0] < needed * spacing:
            yield (
                f'{name}: resonance at {row[0]:.0f} Hz is {2 * row[1] * row[0]:.1f} Hz wide; a line spacing of '
                f'{spacing:.1f} Hz does not resolve it'
            )
