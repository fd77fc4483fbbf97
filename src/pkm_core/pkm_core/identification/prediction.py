"""Prediction of a record by L: stretches of one-way motion, and the motion due to the drive in each."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pkm_core.identification.axis_data import AxisData
from pkm_core.identification.partial_fractions import SLOWEST, PartialFractions

SHORTEST = 40  # [samples] least length of a stretch
_MOVING = 0.03  # [of the largest speed] least speed; a slower start is in the presliding regime of friction
_SMOOTHING = 8  # [samples] span of the speed measurement


@dataclass(frozen=True)
class KnownDynamics:
    """The known dynamics around L."""

    corner: float = np.inf  # [Hz] of the current loop
    delay: float = 0.0  # [s] beyond the whole samples of computation
    modes: np.ndarray | tuple = ()  # (m, 4) of H, see PartialFractions


@dataclass(frozen=True)
class Stretch:
    """Samples `start` to `end` of a record with motion in one direction."""

    data: AxisData
    start: int
    end: int
    direction: float  # +1 or -1

    def of(self, values):
        """Return the part of the record's `values` (N,) in this stretch, less its first value."""
        return values[self.start : self.end] - values[self.start]


@dataclass(frozen=True)
class Prediction:
    """One stretch of motion: the measurement and its regressors."""

    measured: np.ndarray  # y less its first value (N,) [m]
    driven: np.ndarray  # F(a)(u - reaction) (N,) [m per unit of gain]
    nuisance: np.ndarray  # (N, 3) columns: position, initial speed, constant acceleration

    def free(self, values):
        """Return `values` (N,) less their projection on the nuisance."""
        return values - self.nuisance @ np.linalg.lstsq(self.nuisance, values, rcond=None)[0]

    def error(self, gain):
        """Return the prediction error (N,) [m]."""
        return self.free(self.measured - gain * self.driven)

    def constant(self, gain):
        """Return the constant acceleration [m/s^2] of the best fit."""
        return np.linalg.lstsq(self.nuisance, self.measured - gain * self.driven, rcond=None)[0][2]


def moving_stretches(data):
    """
    Return the `Stretch` objects of a record, within its moves if these are known.

    The direction is that of the reference; without one it is that of the measured position.
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
    moving[: data.computation] = 0  # the voltage that acts there precedes the record
    edges = np.flatnonzero(np.diff(moving, prepend=0, append=0))
    return [
        Stretch(data, int(start), int(end), float(moving[start]))
        for start, end in pairwise(edges)
        if moving[start] and end - start >= SHORTEST
    ]


def predict(stretches, viscosity, known):
    """Return one `Prediction` per stretch for the viscosity a [1/s]; all stretches have one sample time."""
    sample_time = stretches[0].data.sample_time
    time = sample_time * np.arange(max(stretch.end - stretch.start for stretch in stretches))
    drive = PartialFractions.of(viscosity, known.corner, known.modes)
    # responses to a pulse of one sample: of the drive voltage, and of a force on the slider
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
