"""
Base of all learning laws: checks, preparation of the record, and the response G from feedforward to position.

The learned feedforward is added before lag and notch of the closed loop. With P the sampled plant including the
computation delay and C = PID FL FN it moves the slider by G = FL FN P/(1 + C P). In steady repetition the error of a
cycle is e = e0 - G u at every frequency. With integral action G(0) = 0: no law divides by it.
"""

from abc import ABC, abstractmethod
from functools import cache
from typing import Annotated

import numpy as np
from pydantic import Field

from pkm_core.config import Config, Number
from pkm_core.control.margins import unit_circle
from pkm_core.control.model import load_model
from pkm_core.control.pid import AxisLaw
from pkm_core.control.systems import plant_system
from pkm_core.errors import LearningError
from pkm_core.learning.band import Band
from pkm_core.learning.request import check_request

LOWEST_MODE = 228.0  # [Hz] of the shipped models (4-DOF d5), for which the bands of config/learning were chosen
EDGE = 5e-3  # [s] averaged at each end of a record; well inside the rest at the cycle boundary


class LawConfig(Config):
    """Parameters common to all laws, the same for all joints."""

    # decreasing gains average disturbances that do not repeat
    gain: Annotated[
        tuple[Annotated[Number, Field(gt=0, le=1)], ...],
        Field(min_length=1, description='of update 0, 1, ...; the last one is kept'),
    ]
    band: Band


class Law(ABC):
    """
    A learning law for all joints of a machine, without state between calls.

    Parameters
    ----------
    config : LawConfig
    machine : Machine
    gains : dict of str to RobustGains
        Gains of the loops.

    Attributes
    ----------
    verdict : str
        Result of its convergence test; '' before the test.

    """

    Parameters: type[LawConfig] = LawConfig  # model of the law's file
    verdict = ''

    def __init__(self, config, machine, gains):
        require_robust(gains)
        self.config, self.machine, self.gains = config, machine, gains
        self.models = load_model(machine)
        self._minimum = int(np.ceil(1 / (config.band.fall_from * machine.sample_time)))  # a period of full weight

    def band(self, joint):
        """
        Return the `Band` of `joint`: that of the law; narrower if a model with `forces` has a mode below 228 Hz.

        Such a model was identified. The bands of the configuration were chosen for the shipped models.
        """
        model = self.models[joint]
        if model.forces is None or not model.modes:
            return self.config.band
        return self.config.band.narrowed(min(mode.resonance for mode in model.modes) / LOWEST_MODE)

    def with_reference(self, trajectory):
        """Return the law for `trajectory` (a `SampledTrajectory` in joints); this law if it needs no reference."""
        return self

    def update(self, joint, error, feedforward, iteration, sample_time):
        """
        Return the feedforward [V] of the next cycle, shape (N,), within plus and minus the machine's voltage limit.

        Parameters
        ----------
        joint : str
            A joint of the machine.
        error : array_like, shape (N,)
            r - y [m] of the cycle.
        feedforward : array_like, shape (N,)
            The learned feedforward [V] of the cycle.
        iteration : int
            Number of updates this feedforward has had.
        sample_time : float
            [s]

        Raises
        ------
        LearningError
            If the joint is unknown, lengths differ or are too short, a value is not finite, or the sample time differs.

        """
        error, feedforward = np.asarray(error, dtype=np.float64), np.asarray(feedforward, dtype=np.float64)
        expected = self.machine.sample_time
        check_request(
            joint, self.gains, error, feedforward, iteration, sample_time,
            expected_time=expected, minimum=self._minimum,
        )  # fmt: skip
        gain = self.config.gain[min(iteration, len(self.config.gain) - 1)]
        return self._bounded(joint, self._learn(joint, closed(error, expected), feedforward, gain))

    def _bounded(self, joint, feedforward):
        if not np.isfinite(feedforward).all():
            raise LearningError(f'learning {joint}: the next feedforward is not finite')
        return np.clip(feedforward, -self.machine.voltage_limit, self.machine.voltage_limit)

    @abstractmethod
    def _learn(self, joint, error, feedforward, gain):
        """Return the next feedforward; the arguments are checked and `error` is closed."""

    @abstractmethod
    def memory(self, joint, frequency):
        """Return the share of the feedforward that an update keeps at `frequency` [Hz]."""

    @abstractmethod
    def action(self, joint, frequency):
        """Return the feedforward per error [V/m] that an update of gain 1 adds at `frequency` [Hz]; 0 at 0 Hz."""

    def path(self, joint, frequency):
        """Return G [m/V] of the model at `frequency` [Hz], which must not be 0."""
        return learned_path(self.gains[joint], self.models[joint], frequency, self.machine.sample_time)


class FrequencyLaw(Law):
    """A law without coupling of frequencies: U <- memory U + gain action E for the Fourier series of a cycle."""

    def __init__(self, config, machine, gains):
        super().__init__(config, machine, gains)
        self._on_grid = cache(self._on_grid)  # type: ignore[method-assign]

    def _learn(self, joint, error, feedforward, gain):
        memory, action = self._on_grid(joint, error.size)
        return np.fft.irfft(memory * np.fft.rfft(feedforward) + gain * action * np.fft.rfft(error), error.size)

    def _on_grid(self, joint, samples):
        frequency = np.fft.rfftfreq(samples, self.machine.sample_time)
        return self.memory(joint, frequency), self.action(joint, frequency)


def require_robust(gains):
    """Raise `LearningError` unless all `gains` {joint: gains} are laws of single axes."""
    for joint, axis in gains.items():
        if not isinstance(axis, AxisLaw):
            raise LearningError(f'learning: {joint} has {type(axis).__name__}; only controllers of single axes learn')


def closed(error, sample_time):
    """
    Return the record `error` (N,) minus the ramp between its ends.

    A Fourier series is that of a periodic signal. If first and last sample differ, the law would learn a step at the
    boundary. But the difference is a change from cycle to cycle, which the integrator removes; it does not repeat.
    """
    edge = max(1, min(round(EDGE / sample_time), error.size // 2))
    slope = (error[-edge:].mean() - error[:edge].mean()) / (error.size - edge)
    return error - slope * (np.arange(error.size) - (error.size - 1) / 2)


def learned_path(gains, model, frequency, sample_time):
    """Return G [m/V], learned feedforward to position, of a loop on an `AxisModel` at `frequency` [Hz], not 0."""
    z = unit_circle(frequency, sample_time)
    return path_through(gains, plant_system(model, sample_time)(z), z, sample_time)


def path_through(gains, plant, z, sample_time):
    """Return G [m/V] at the points `z` for the plant response `plant` [m/V]; shapes are broadcast."""
    forward = gains.response(z, sample_time) * plant
    return forward / (1 + forward) / gains.pid_response(z, sample_time)
