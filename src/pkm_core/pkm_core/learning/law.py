"""
What all learning laws share: what they refuse, the record they learn from, and the path they learn through.

The learned feedforward enters before lag and notch of the closed loop, so with P the sampled plant behind the
computation delay and C = PID FL FN it moves the slider by G = FL FN P/(1 + C P). In steady repetition the error of a
cycle is e = e0 - G u, frequency by frequency. G(0) = 0 where the loop integrates: no law ever divides by it.
"""

from abc import ABC, abstractmethod
from functools import cache
from typing import Annotated

import numpy as np
from pydantic import Field

from pkm_core.config import Config, Number
from pkm_core.control.margins import unit_circle
from pkm_core.control.model import load_model
from pkm_core.control.pid import PidLaw
from pkm_core.control.systems import plant_system
from pkm_core.errors import LearningError
from pkm_core.learning.band import Band
from pkm_core.learning.request import check_request

EDGE = 5e-3  # [s] over which the ends of a record are averaged; well inside the rest the cycle's boundary lies in


class LawConfig(Config):
    """Parameters every law has, the same for all joints; a law's own come in its file."""

    # of update 0, 1, ...; the last one stays. Smaller ones average what does not repeat.
    gain: Annotated[
        tuple[Annotated[Number, Field(gt=0, le=1)], ...],
        Field(min_length=1, description='of update 0, 1, ...; the last one is kept'),
    ]
    band: Band


class Law(ABC):
    """
    A learning law for all joints of a machine; it keeps nothing between calls.

    Parameters
    ----------
    config : LawConfig
    machine : Machine
    control : dict of str to RobustGains
        The loops it learns for.

    Attributes
    ----------
    verdict : str
        What its convergence test found; '' before.

    """

    Parameters: type[LawConfig] = LawConfig  # model of the law's file
    verdict = ''

    def __init__(self, config, machine, control):
        for joint, gains in control.items():
            if not isinstance(gains, PidLaw):
                raise LearningError(f'learning: {joint} has {type(gains).__name__}; only robust control learns')
        self.config, self.machine, self.control = config, machine, control
        self.models = load_model(machine)
        self._minimum = int(np.ceil(1 / (config.band.fall_from * machine.sample_time)))  # a period of full weight

    def with_reference(self, trajectory):
        """Return the law for the motion `trajectory` (a `SampledTrajectory` in joints): this one, if it needs none."""
        return self

    def update(self, joint, error, feedforward, iteration, sample_time):
        """
        Return the feedforward [V] of the next cycle, shape (N,), within plus and minus the machine's voltage limit.

        Parameters
        ----------
        joint : str
            One of the machine's.
        error : array_like, shape (N,)
            r - y [m] of the cycle.
        feedforward : array_like, shape (N,)
            The learned feedforward [V] it was driven with.
        iteration : int
            How many updates this feedforward has had.
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
            joint, self.control, error, feedforward, iteration, sample_time,
            expected_time=expected, minimum=self._minimum,
        )  # fmt: skip
        gain = self.config.gain[min(iteration, len(self.config.gain) - 1)]
        return self._bounded(joint, self._learn(joint, closed(error, expected), feedforward, gain))

    def _bounded(self, joint, feedforward):
        if not np.isfinite(feedforward).all():
            raise LearningError(f'learning {joint}: the feedforward would not be finite')
        return np.clip(feedforward, -self.machine.voltage_limit, self.machine.voltage_limit)

    @abstractmethod
    def _learn(self, joint, error, feedforward, gain):
        """Return the next feedforward; arguments are checked, `error` is closed."""

    @abstractmethod
    def memory(self, joint, frequency):
        """Return what an update keeps of the feedforward at `frequency` [Hz]."""

    @abstractmethod
    def action(self, joint, frequency):
        """Return what an update of gain 1 adds for the error [V/m] at `frequency` [Hz]; 0 at 0 Hz."""

    def path(self, joint, frequency):
        """Return the model's G [m/V] at `frequency` [Hz], never 0."""
        return learned_path(self.control[joint], self.models[joint], frequency, self.machine.sample_time)


class FrequencyLaw(Law):
    """A law that treats every frequency by itself: U <- memory U + gain action E over the Fourier series of a cycle."""

    def __init__(self, config, machine, control):
        super().__init__(config, machine, control)
        self._on_grid = cache(self._on_grid)  # type: ignore[method-assign]

    def _learn(self, joint, error, feedforward, gain):
        memory, action = self._on_grid(joint, error.size)
        return np.fft.irfft(memory * np.fft.rfft(feedforward) + gain * action * np.fft.rfft(error), error.size)

    def _on_grid(self, joint, samples):
        frequency = np.fft.rfftfreq(samples, self.machine.sample_time)
        return self.memory(joint, frequency), self.action(joint, frequency)


def closed(error, sample_time):
    """
    Return the record `error` (N,) less the ramp between its ends.

    A Fourier series takes the record as one turn of an endless one. Where the error has moved on between its first and
    its last sample, the jump would be learned as a kick at the boundary, though it is a change from cycle to cycle,
    which the integrator deals with, and nothing that repeats.
    """
    edge = max(1, min(round(EDGE / sample_time), error.size // 2))
    slope = (error[-edge:].mean() - error[:edge].mean()) / (error.size - edge)
    return error - slope * (np.arange(error.size) - (error.size - 1) / 2)


def learned_path(gains, model, frequency, sample_time):
    """Return G [m/V], learned feedforward to position, of a loop on an `AxisModel` at `frequency` [Hz], never 0."""
    z = unit_circle(frequency, sample_time)
    return path_through(gains, plant_system(model, sample_time)(z), z, sample_time)


def path_through(gains, plant, z, sample_time):
    """Return G [m/V] at the points `z` where the plant's response is `plant` [m/V], any shapes that broadcast."""
    forward = gains.response(z, sample_time) * plant
    return forward / (1 + forward) / gains.pid_response(z, sample_time)
