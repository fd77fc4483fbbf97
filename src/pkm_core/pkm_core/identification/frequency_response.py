"""
Frequency response P(jw) of an axis from closed-loop records, with its uncertainty at every frequency.

u and y both contain noise fed back by the loop, so S_yu/S_uu is biased towards -1/C. The excitation r is free of noise.
It is the instrument of P = S_yr/S_ur (joint input-output method), which is consistent for any loop. Spectra are means
over segments. A periodic excitation is cut into whole periods, which leaves no leakage. Any other is cut into eighths
of a pass with a Hann window, half overlapping. Without a recorded excitation the estimate is S_yu/S_uu, with a warning.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import SATURATED

_SPREAD = 9  # [lines] the variance is averaged over these; that of a few segments alone is inaccurate
_EXACT = 1e-12  # least relative variance: a filter of running sums may return zero or less
_ALIKE = 0.5  # [of the power] least correlation of a lag that may be a period
_WEAK = 1e-4  # [of the strongest line] least power of an excited line
_GAP = 20  # [samples] zero excitation that ends a pass; a sine crosses zero in one sample
_OVERLAP = 1.06  # variance of half overlapping Hann segments: neighbours share (1/6)^2 of their power
_PARTS = 8  # segments of a pass without a period
_SHORTEST = 256  # [samples] least length of such a segment


@dataclass(frozen=True)
class FrequencyResponse:
    """Response P over a band, with computation and hold."""

    name: str
    frequency: np.ndarray  # (F,) ascending [Hz]
    plant: np.ndarray  # (F,) complex [m/V]
    deviation: np.ndarray  # (F,) standard deviation of `plant` [m/V]
    coherence: np.ndarray  # (F,) between excitation and position, 0 to 1
    segments: int
    position: float  # [m] mean position of the axis
    periodic: bool
    instrument: bool  # whether the excitation is the instrument
    warnings: tuple[str, ...]

    def initial_gain(self, share=0.15):
        """Return the mean |w^2 P| [m/s^2/V] over the first `share` of the lines."""
        first = slice(0, max(1, round(share * self.frequency.size)))
        return float(np.mean((2 * np.pi * self.frequency[first]) ** 2 * np.abs(self.plant[first])))


def estimate_response(data, band=None):
    """
    Return the `FrequencyResponse` of an `AxisData`.

    The default of `band` [Hz] holds 99 % of the power of the excitation or, without one, of the voltage.

    Raises
    ------
    IdentificationError
        If the band exceeds half the sampling rate or has no line, the excitation is zero, the axis does not move, the
        record is shorter than two segments, or more than SATURATED of it is at the drive's limit.

    """
    data.check_follows()
    source = data.voltage if data.excitation is None else data.excitation
    starts, length, periodic = _segments(data, source)
    saturated = np.mean([data.saturated(start, start + length) / length for start in starts])
    if saturated > SATURATED:
        raise IdentificationError(
            f'{data.name}: the excitation is saturated: {100 * saturated:.1f} % of the samples are at '
            f'{data.limit:g} V; allowed {100 * SATURATED:g} %'
        )
    frequency = np.fft.rfftfreq(length, data.sample_time)
    R, U, Y = (_spectra(values, starts, length, periodic) for values in (source, data.voltage, data.position))
    lines = _lines(data, frequency, np.sum(np.abs(R) ** 2, axis=0), band)
    R, U, Y = (spectra[:, lines] for spectra in (R, U, Y))
    if not Y.any():
        raise IdentificationError(
            f'{data.name}: the position does not respond to the excitation; check that the axis is enabled'
        )
    driven, moved = (np.sum(spectra * R.conj(), axis=0) for spectra in (U, Y))
    plant = moved / driven
    power = np.sum(np.abs(R) ** 2, axis=0) * np.sum(np.abs(Y) ** 2, axis=0)
    scatter = np.sum(np.abs((Y - plant * U) * R.conj()) ** 2, axis=0) / np.abs(moved) ** 2
    scatter *= len(starts) / (len(starts) - 1) * (1.0 if periodic else _OVERLAP)
    warnings = []
    if saturated:
        warnings.append(f'{data.name}: {100 * saturated:.2f} % of the samples are at the limit of {data.limit:g} V')
    if data.excitation is None:
        warnings.append(f'{data.name}: no excitation recorded; the estimate S_yu/S_uu is biased by feedback of noise')
    return FrequencyResponse(
        name=data.name,
        frequency=frequency[lines],
        plant=plant,
        deviation=np.abs(plant) * np.sqrt(np.maximum(uniform_filter1d(scatter, min(_SPREAD, scatter.size)), _EXACT)),
        coherence=np.abs(moved) ** 2 / power,
        segments=len(starts),
        position=float(np.mean([data.position[start : start + length].mean() for start in starts])),
        periodic=periodic,
        instrument=data.excitation is not None,
        warnings=tuple(warnings),
    )


def _lines(data, frequency, power, band):
    """Return a mask (F,) of the lines in the band that carry power."""
    if band is None:
        share = np.cumsum(power) / np.sum(power)
        low, high = np.searchsorted(share, (0.005, 0.995))
        band = max(frequency[low], frequency[1]), min(frequency[high], frequency[-2])
    nyquist = 0.5 / data.sample_time
    if not 0 < band[0] < band[1] < nyquist:
        raise IdentificationError(
            f'{data.name}: band {band[0]:g} to {band[1]:g} Hz; expected 0 < from < to < {nyquist:g} Hz, half the '
            f'sampling rate'
        )
    lines = (frequency >= band[0]) & (frequency <= band[1]) & (power > _WEAK * power.max())
    if not lines.any():
        raise IdentificationError(
            f'{data.name}: nothing was excited from {band[0]:g} to {band[1]:g} Hz; the strongest line is at '
            f'{frequency[power.argmax()]:.1f} Hz'
        )
    return lines


def _segments(data, source):
    """Return the first samples of the segments, the length of a segment and whether it is a whole period."""
    passes = _passes(source)
    if not passes:
        raise IdentificationError(f'{data.name}: no excitation: it is zero at all {len(source)} samples')
    longest = max(passes, key=lambda each: each[1] - each[0])
    length = step = _period(source[slice(*longest)])
    periodic = length is not None
    if not periodic:
        length = max((longest[1] - longest[0]) // _PARTS, _SHORTEST)
        step = length // 2
    starts = []
    for begin, end in passes:  # counted from the end: the remainder lies at the beginning, where the axis settles
        found = list(range(end - length, begin - 1, -step))
        starts += found if len(found) > 1 or not periodic else []
    if len(starts) < 2:
        raise IdentificationError(
            f'{data.name}: the excitation lasts for {sum(b - a for a, b in passes)} samples, {len(starts)} segments of '
            f'{length}; at least 2 are needed'
        )
    return sorted(starts), length, periodic


def _passes(source):
    """Return (start, end) of the parts of `source` between zeros longer than _GAP."""
    active = np.flatnonzero(source)
    if active.size == 0:
        return []
    cuts = np.flatnonzero(np.diff(active) > _GAP)
    return list(zip(active[np.append(0, cuts + 1)], active[np.append(cuts, -1)] + 1, strict=True))


def _period(values):
    """Return the period [samples] of `values`, or None if they do not repeat exactly."""
    lags = np.arange(values.size // 2 + 1)
    spectrum = np.abs(np.fft.rfft(values, 2 * values.size)) ** 2
    likeness = np.fft.irfft(spectrum)[: lags.size] / (values.size - lags)
    for lag in np.flatnonzero(likeness[2:] > _ALIKE * likeness[0]) + 2:
        if np.array_equal(values[lag:], values[:-lag]):
            return int(lag)
    return None


def _spectra(values, starts, length, periodic):
    """
    Return the spectra (segments, F) of the segments without the drift of the jog.

    The drift of a period is its difference from the neighbouring period. A straight line fitted to one period would
    remove a part of the sweep, and a different part from u than from y.
    """
    rows = np.stack([values[start : start + length] for start in starts])
    rows = rows - rows.mean(axis=1, keepdims=True)
    if not periodic:
        return np.fft.rfft(rows * np.hanning(length + 1)[:-1], axis=1)
    for i, start in enumerate(starts):
        other = start + length if start + length in starts else start - length
        step = np.mean(values[other : other + length] - values[start : start + length]) / (other - start)
        rows[i] -= step * (np.arange(length) - 0.5 * (length - 1))
    return np.fft.rfft(rows, axis=1)
