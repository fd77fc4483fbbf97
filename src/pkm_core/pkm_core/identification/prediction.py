"""What L predicts of a record: stretches of one-way motion, and what the drive moves in them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pkm_core.identification.axis_data import AxisData
from pkm_core.identification.partial_fractions import SLOWEST, PartialFractions

SHORTEST = 40  # samples of a stretch that is used
_MOVING = 0.03  # of the largest speed: below, a slider that starts is still bending its bristles
_SMOOTHING = 8  # samples over which speed is measured


@dataclass(frozen=True)
class KnownDynamics:
    """What the prediction takes as known beside L."""

    corner: float = np.inf  # [Hz] of the current loop
    delay: float = 0.0  # [s] beyond the whole samples of computation
    modes: np.ndarray | tuple = ()  # (m, 4) of H, see PartialFractions


@dataclass(frozen=True)
class Stretch:
    """Samples `start` to `end` of a record, in which the axis moves one way."""

    data: AxisData
    start: int
    end: int
    direction: float  # +1 or -1

    def of(self, values):
        """Return the part of `values` (N,) of the record, from its first sample on, less that one."""
        return values[self.start : self.end] - values[self.start]


@dataclass(frozen=True)
class Prediction:
    """One stretch of motion: what was measured and what the drive explains of it."""

    measured: np.ndarray  # y less its first value (N,) [m]
    driven: np.ndarray  # F(a)(u - reaction) (N,) [m per unit of gain]
    nuisance: np.ndarray  # (N, 3) columns: position, initial speed, constant acceleration

    def free(self, values):
        """Return `values` (N,) less what the nuisance can explain of them."""
        return values - self.nuisance @ np.linalg.lstsq(self.nuisance, values, rcond=None)[0]

    def error(self, gain):
        """Return the prediction error (N,) [m]."""
        return self.free(self.measured - gain * self.driven)

    def constant(self, gain):
        """Return the constant acceleration [m/s^2] that fits best."""
        return np.linalg.lstsq(self.nuisance, self.measured - gain * self.driven, rcond=None)[0][2]


def moving_stretches(data):
    """
    Return the `Stretch` objects of a record, within its moves if they are known.

    They are looked for in the reference where there is one.
    """
    source = data.position if data.reference is None else data.reference
    speed, half = np.zeros(len(source)), _SMOOTHING // 2
    if len(source) > _SMOOTHING:
        speed[half:-half] = (source[_SMOOTHING:] - source[:-_SMOOTHING]) / (_SMOOTHING * data.sample_time)
    if data.moves:
        within = np.zeros(len(source), dtype=bool)
        for start, end in data.moves:
            within[start:end] = True
        speed *= within
    moving = np.where(np.abs(speed) > _MOVING * np.abs(speed).max(), np.sign(speed), 0)
    moving[: data.computation] = 0  # what acted there was not recorded
    edges = np.flatnonzero(np.diff(moving, prepend=0, append=0))
    return [
        Stretch(data, int(start), int(end), float(moving[start]))
        for start, end in pairwise(edges)
        if moving[start] and end - start >= SHORTEST
    ]


def predict(stretches, viscosity, known):
    """Return a `Prediction` for each of `stretches`, all of one sample time, with the viscosity a [1/s]."""
    sample_time = stretches[0].data.sample_time
    time = sample_time * np.arange(max(stretch.end - stretch.start for stretch in stretches))
    drive = PartialFractions.of(viscosity, known.corner, known.modes)
    # what a pulse of one sample moves, by the drive and by a force on the slider itself
    pulse = np.diff(drive.step(time - known.delay), prepend=0.0)
    push = np.diff(PartialFractions.of(viscosity, np.inf, known.modes).step(time), prepend=0.0)
    rate = max(viscosity, SLOWEST)
    nuisance = np.column_stack([np.ones(time.size), -np.expm1(-rate * time) / rate, np.cumsum(push)])
    predictions = []
    for stretch in stretches:
        count, late = stretch.end - stretch.start, stretch.data.computation
        volts = stretch.data.net_voltage[stretch.start - late : stretch.end - late]
        driven = np.convolve(volts, pulse[:count])[:count]
        predictions.append(Prediction(stretch.of(stretch.data.position), driven, nuisance[:count]))
    return predictions
