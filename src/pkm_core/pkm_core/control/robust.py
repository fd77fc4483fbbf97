"""
The robust controller of one axis, thesis (7.21)-(7.25), as it runs on every encoder tick.

    e = r - y
    uc = KP e + I + D,  I = I + KI Ts e,  D = (tau D + KD (e - e_previous))/(tau + Ts)
    uf = Kv v + Ka a + Kj j + learned
    u = FL FN (uc + uf), held within +-limit

The feedforward passes the filters. The integrator stands still while u is held and e would drive it further.
"""

import math
from typing import Annotated

import numpy as np
from numba import njit
from pydantic import Field

from pkm_core.config import Config, Time, find_config, load_config, quantity
from pkm_core.control import filters
from pkm_core.control.model import in_joint_order
from pkm_core.errors import PkmError


class RobustGains(Config):
    """Feedback of one axis in physical units (the thesis prints its gains per sample and per count)."""

    kp: Annotated[quantity('V/m'), Field(gt=0)]
    ki: Annotated[quantity('V/(m s)'), Field(ge=0)]
    kd: Annotated[quantity('V s/m'), Field(ge=0)]
    derivative_filter: Annotated[Time, Field(ge=0)]  # tau, the t of (7.21)
    lag: filters.Lag
    notch: filters.Notch

    def pid_response(self, z, sample_time, *, integral=1.0, derivative=1.0):
        """Return KP + `integral` I + `derivative` D [V/m] at the points `z` of the unit circle, z = 1 excluded."""
        tau, difference = self.derivative_filter, 1 - 1 / z
        slope = self.kd * difference / (sample_time + tau * difference)
        return self.kp + integral * self.ki * sample_time / difference + derivative * slope


class _Control(Config):
    joints: dict[str, RobustGains]


def load_control(machine, name_or_path=None):
    """Return {joint: RobustGains} of config/control, by default of the file called like the machine."""
    path = find_config('control', name_or_path or machine.name)
    return in_joint_order(machine, load_config(path, _Control).joints, path)


def feedforward_gains(gains, model, sample_time):
    """
    Return Kv [V s/m], Ka [V s^2/m], Kj [V s^3/m] of (7.24): the inverse of K exp(-s dl)/(s (s + a)) to third order.

    dl = computation delay and hold (1.5 Ts), current loop, modes, lag and notch, each by its delay of slow signals.
    """
    delay = 1.5 * sample_time + model.low_frequency_delay()
    for stage in (gains.lag, gains.notch):
        delay += filters.low_frequency_delay(stage.discrete(sample_time), sample_time)
    return model.viscosity / model.gain, (1 + model.viscosity * delay) / model.gain, delay / model.gain


@njit(cache=True)
def _step(index, measured, reference, feedforward, parameters, state):
    """Advance `state` by one tick and return voltage and error. Layout of both arrays: RobustController.__init__."""
    kp, ki_ts, kd, carry, limit = parameters[0], parameters[1], parameters[2], parameters[3], parameters[4]
    error = reference[index] - measured
    previous = error if math.isnan(state[2]) else state[2]
    integral = state[0] + ki_ts * error
    derivative = carry * state[1] + kd * (error - previous)
    signal = kp * error + integral + derivative + feedforward[index]
    for stage in range(2):  # lag, notch: transposed direct form II
        b, s = 5 + 5 * stage, 3 + 2 * stage
        output = parameters[b] * signal + state[s]
        state[s] = parameters[b + 1] * signal - parameters[b + 3] * output + state[s + 1]
        state[s + 1] = parameters[b + 2] * signal - parameters[b + 4] * output
        signal = output
    voltage = min(max(signal, -limit), limit)
    if voltage == signal or error * signal <= 0.0:
        state[0] = integral
    state[1] = derivative
    state[2] = error
    return voltage, error


class RobustController:
    """
    The controller of one axis: `load` a cycle, then `update` once a tick.

    Loading the next cycle exchanges reference and feedforward; integrator, derivative and filters run on, and the
    integrator takes up the step between the two feedforwards, so that the voltage does not jump at the boundary. (A
    learned feedforward changes its level every cycle; such a step moved a resting slider by 2 um for 20 ms.)

    Parameters
    ----------
    gains : RobustGains
    model : AxisModel
        For the feedforward.
    sample_time : float
        Ts [s].
    voltage_limit : float
        The output is held within plus and minus this [V].

    """

    def __init__(self, gains, model, sample_time, voltage_limit):
        self.feedforward_gains = feedforward_gains(gains, model, sample_time)
        carry = gains.derivative_filter / (gains.derivative_filter + sample_time)
        slope = gains.kd / (gains.derivative_filter + sample_time)
        self._parameters = np.array([
            *(gains.kp, gains.ki * sample_time, slope, carry, voltage_limit),
            *gains.lag.discrete(sample_time),
            *gains.notch.discrete(sample_time),
        ])  # fmt: skip
        self._state = np.empty(7)  # integral, derivative, previous error, lag (2), notch (2)
        self.reset()
        # numba compiles, or loads what it has compiled, at the first call: here, not in the first tick
        _step(0, 0.0, np.zeros(1), np.zeros(1), self._parameters, self._state.copy())

    def reset(self):
        """Forget everything: no cycle is loaded and the axis is taken to be at rest."""
        self._state[:] = 0.0
        self._state[2] = np.nan  # no previous error: the first difference is zero, not a kick
        self._samples = 0
        self._reference = self._feedforward = np.empty(0)

    def load(self, position, velocity, acceleration, jerk, learned):
        """
        Take the reference of one cycle [m, m/s, m/s^2, m/s^3] and its learned feedforward [V], each of shape (N,).

        Raises
        ------
        PkmError
            If lengths differ or a value is not finite; what was loaded before stays.

        """
        rows = [np.array(values, dtype=np.float64) for values in (position, velocity, acceleration, jerk, learned)]
        samples = rows[0].size
        for name, row in zip(('position', 'velocity', 'acceleration', 'jerk', 'learned'), rows, strict=True):
            if row.shape != (samples,) or samples == 0:
                raise PkmError(f'cycle: {name} has shape {row.shape}; expected (N,) as position, N >= 1')
            if not np.isfinite(row).all():
                index = int(np.argmin(np.isfinite(row)))
                raise PkmError(f'cycle: {name} is {row[index]} at sample {index}; expected a finite number')
        position, velocity, acceleration, jerk, learned = rows
        kv, ka, kj = self.feedforward_gains
        feedforward = kv * velocity + ka * acceleration + kj * jerk + learned
        # cycles repeat: after the last sample the old feedforward would have gone on with its first one
        self._state[0] += (self._feedforward[0] if self._samples else 0.0) - feedforward[0]
        self._samples, self._reference, self._feedforward = samples, position, feedforward

    def update(self, index, measured):
        """
        Return voltage [V] and error r - y [m] for sample `index` of the loaded cycle and the `measured` position [m].

        Raises
        ------
        PkmError
            If the measurement is not finite or the loaded cycle has no such sample; the state stays as it was.

        """
        if not math.isfinite(measured):
            raise PkmError(f'sample {index}: measured position is {measured}; expected a finite number of metres')
        if not 0 <= index < self._samples:
            raise PkmError(f'sample {index}: the loaded cycle has {self._samples} samples, counted from 0')
        return _step(index, measured, self._reference, self._feedforward, self._parameters, self._state)
