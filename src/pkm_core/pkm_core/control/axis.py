"""
The controller of one axis from cycle to cycle, whatever its law: reference, feedforward, checks and saturation count.

A law adds its compiled `step` and the state that it keeps between ticks: robust.py and observer.py.
"""

import math
from abc import ABC, abstractmethod

import numpy as np

from pkm_core.control import filters
from pkm_core.control.forces import CycleForces, feedforward
from pkm_core.errors import PkmError


def feedforward_gains(gains, model, sample_time):
    """
    Return Kv [V s/m], Ka [V s^2/m], Kj [V s^3/m] of (7.24): the inverse of K exp(-s dl)/(s (s + a)) to third order.

    dl is the sum of the delays of slow signals: computation and hold (1.5 Ts), current loop, modes, lag and notch.
    """
    delay = 1.5 * sample_time + model.low_frequency_delay()
    for stage in gains.stages:
        delay += filters.low_frequency_delay(stage.discrete(sample_time), sample_time)
    whole = model.gain * gains.dc_gain  # the gain of the notch at rest is 1
    return model.viscosity / whole, (1 + model.viscosity * delay) / whole, delay / whole


class AxisController(ABC):
    """
    The controller of one axis: `load` a cycle, then `update` once per tick.

    Loading the next cycle replaces reference and feedforward; the law keeps its state. Its integral action takes up the
    step between the two feedforwards, which keeps the voltage continuous at the boundary. (A learned feedforward
    changes its level in every cycle; without this, the step moved a resting slider by 2 um for 20 ms.)

    Parameters
    ----------
    gains : AxisLaw
        Of `load_control` or `load_observer`.
    model : AxisModel
        For the feedforward.
    sample_time : float
        Ts [s].
    voltage_limit : float
        The output saturates at plus and minus this value [V].

    """

    def __init__(self, gains, model, sample_time, voltage_limit):
        self._model, self._sample_time, self._voltage_limit = model, sample_time, voltage_limit
        self._take(gains)
        self._state = np.empty(0)
        self.reset()
        # numba compiles or loads its cache at the first call: here, not in the first tick
        self.step(0, 0.0, np.zeros(1), np.zeros(1), self._parameters, self._state.copy())

    @staticmethod
    @abstractmethod
    def step(index, measured, reference, feedforward, parameters, state):
        """Advance `state` by one tick and return voltage [V] and error [m]; a compiled function."""

    @abstractmethod
    def _parameters_of(self, gains):
        """Return the array `parameters` of `step` for the law `gains`."""

    @abstractmethod
    def _rest(self):
        """Return the state of the law at rest; its last value counts samples at the limit."""

    @abstractmethod
    def _take_up(self, voltage):
        """Add `voltage` [V] to the output of the law by its integral action."""

    def _take(self, gains):
        self.gains = gains
        self.feedforward_gains = feedforward_gains(gains, self._model, self._sample_time)
        self._parameters = self._parameters_of(gains)

    def reset(self):
        """Return to the initial state: no cycle is loaded and the axis is assumed to be at rest."""
        self._state = self._rest()
        self._samples = self._next = 0
        self._reference = self._feedforward = np.empty(0)
        self._after = 0.0  # [V] the feedforward if it continued after the last sample
        self._friction = 0.0  # z of forces.py after the loaded cycle
        self._motion: tuple = ()
        self._forces = CycleForces(*np.empty((4, 0)), self._friction)

    def load(self, position, velocity, acceleration, jerk, learned, coupling=None):
        """
        Load the reference of one cycle [m, m/s, m/s^2, m/s^3] and its learned feedforward [V], each of shape (N,).

        `coupling` (N,) [V] is that of `coupling_voltage`; only a model with `forces` uses it.

        Raises
        ------
        PkmError
            If lengths differ or a value is not finite; the previous cycle stays loaded.

        """
        rows = [np.array(values, dtype=np.float64) for values in (position, velocity, acceleration, jerk, learned)]
        samples = rows[0].size
        for name, row in zip(('position', 'velocity', 'acceleration', 'jerk', 'learned'), rows, strict=True):
            if row.shape != (samples,) or samples == 0:
                raise PkmError(f'cycle: {name} has shape {row.shape}; expected (N,) as position, N >= 1')
            if not np.isfinite(row).all():
                index = int(np.argmin(np.isfinite(row)))
                raise PkmError(f'cycle: {name} is {row[index]} at sample {index}; expected a finite number')
        self._motion, before = tuple(rows[1:]), self._after
        coupling = np.zeros(samples) if coupling is None else coupling
        self._forces = CycleForces(rows[0], rows[1], rows[2], coupling, self._friction)
        self._feedforward = self._sum_feedforward()
        self._take_up(before - self._feedforward[0])
        self._samples, self._next, self._reference = samples, 0, rows[0]
        self._state[-1] = 0.0

    def extend(self, offset, position, velocity, acceleration, jerk, coupling):
        """
        Replace the reference from sample `offset` on by rows (M,) as of `load`, without learned feedforward.

        The cycle is running: the state of the law stays.
        """
        rows = position, velocity, acceleration, jerk, np.zeros(len(position))
        before = self._reference, *self._motion
        whole = [np.concatenate([old[:offset], new]) for old, new in zip(before, rows, strict=True)]
        coupling = np.concatenate([self._forces.coupling[:offset], coupling])
        self._forces = CycleForces(whole[0], whole[1], whole[2], coupling, self._forces.start)
        self._reference, self._motion, self._samples = whole[0], tuple(whole[1:]), len(whole[0])
        self._feedforward = self._sum_feedforward()

    def _sum_feedforward(self):
        """Return the feedforward (N,) [V] of the loaded cycle, and store its continuation after the cycle."""
        velocity, acceleration, jerk, learned = self._motion
        kv, ka, kj = self.feedforward_gains
        plain = kv * velocity + ka * acceleration + kj * jerk
        whole = plain + learned
        self._after = whole[0]  # cycles repeat: after its last sample the feedforward continues with its first one
        model = self._model_with_forces()
        if model.forces is not None:
            added = feedforward(self._forces, plain, self.gains, model, self._sample_time)
            self._friction = self._forces.friction(model)[-1]
            self._after += added[-1]
            whole += added[:-1]
        return whole

    def _model_with_forces(self):
        """Return the model of the feedforward; without `forces` (7.24) alone is used."""
        return self._model

    def _feedforward_at(self, index):
        """Return the feedforward [V] of sample `index`, up to the one after the last."""
        return self._feedforward[index] if index < self._samples else self._after

    @property
    def saturated(self):
        """The number of samples of the loaded cycle whose voltage was limited."""
        return int(self._state[-1])

    def compiled(self):
        """Return reference, feedforward, parameters and state for a compiled loop that calls `step` on all samples."""
        self._next = self._samples
        return self._reference, self._feedforward, self._parameters, self._state

    def update(self, index, measured):
        """
        Return voltage [V] and error r - y [m] for sample `index` of the loaded cycle and the `measured` position [m].

        Raises
        ------
        PkmError
            If the measurement is not finite or the loaded cycle has no such sample; the state is unchanged.

        """
        if not math.isfinite(measured):
            raise PkmError(f'sample {index}: measured position is {measured}; expected a finite number of metres')
        if not 0 <= index < self._samples:
            raise PkmError(f'sample {index}: the loaded cycle has {self._samples} samples, counted from 0')
        self._next = index + 1
        return self.step(index, measured, self._reference, self._feedforward, self._parameters, self._state)
