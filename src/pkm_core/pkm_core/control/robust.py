"""
The robust controller of one axis, thesis (7.21)-(7.25), evaluated once per encoder tick.

    e = r - y
    uc = KP e + I + D,  I = I + KI Ts e,  D = (tau D + KD (e - e_previous))/(tau + Ts)
    uf = Kv v + Ka a + Kj j + learned
    u = FL FN (uc + uf), saturated at +-limit

The feedforward passes the filters; Kv, Ka, Kj include their gain at rest. A model with `forces` adds the feedforward of
forces.py, computed when a cycle is loaded. Anti-windup: the integrator is frozen while u is saturated and e would drive
it further.
"""

import math
from typing import Annotated

import numpy as np
from numba import njit
from pydantic import Field

from pkm_core.config import Config, Time, load_config, quantity
from pkm_core.control import filters
from pkm_core.control.axis import AxisController
from pkm_core.control.margins import require_stable
from pkm_core.control.model import in_joint_order, load_model
from pkm_core.control.pid import PidLaw


class RobustGains(PidLaw, Config):
    """Feedback gains of one axis in physical units; the thesis prints its gains per sample and per count."""

    kp: Annotated[quantity('V/m'), Field(gt=0, description='KP')]
    ki: Annotated[quantity('V/(m s)'), Field(ge=0, description='KI')]
    kd: Annotated[quantity('V s/m'), Field(ge=0, description='KD')]
    derivative_filter: Annotated[Time, Field(ge=0, description='tau, the t of (7.21)')]
    lag: filters.Lag
    notch: filters.Notch

    @property
    def stages(self):
        """The filters behind the PID, in their order."""
        return self.lag, self.notch

    @property
    def dc_gain(self):
        """Gain of the filters at rest: that of the lag."""
        return self.lag.dc_gain


class ControlFile(Config):
    """Gains of the robust controllers."""

    joints: dict[str, RobustGains]


def load_control(machine, name_or_path=None):
    """
    Return {joint: RobustGains} of config/control, by default of the file with the machine's name.

    Raises
    ------
    ConfigError
        If the file is refused or its joints are not those of the machine.
    PkmError
        If the loop of an axis is unstable on its model; the margin is in the message.

    """
    path = machine.configuration.find('control', name_or_path or machine.name)
    gains = in_joint_order(machine, load_config(path, ControlFile).joints, path)
    for joint, model in load_model(machine).items():
        require_stable(f'{path}: {joint}', gains[joint], model, machine.sample_time)
    return gains


@njit(cache=True)
def step(index, measured, reference, feedforward, parameters, state):
    """Advance `state` by one tick and return voltage and error. Layout of both arrays: RobustController."""
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
    if voltage != signal:
        state[7] += 1.0
    if voltage == signal or error * signal <= 0.0:
        state[0] = integral
    state[1] = derivative
    state[2] = error
    return voltage, error


class RobustController(AxisController):
    """The robust controller of one axis, see `AxisController`; `gains` are `RobustGains`."""

    step = staticmethod(step)

    def _parameters_of(self, gains):
        carry = gains.derivative_filter / (gains.derivative_filter + self._sample_time)
        slope = gains.kd / (gains.derivative_filter + self._sample_time)
        return np.array([
            *(gains.kp, gains.ki * self._sample_time, slope, carry, self._voltage_limit),
            *gains.lag.discrete(self._sample_time),
            *gains.notch.discrete(self._sample_time),
        ])  # fmt: skip

    def _rest(self):
        state = np.zeros(8)  # integral, derivative, previous error, lag (2), notch (2), samples at the limit
        state[2] = np.nan  # no previous error: the first difference is zero
        return state

    def _take_up(self, voltage):
        self._state[0] += voltage

    def exchange(self, gains, model=None):
        """
        Use other `gains`, and another `model` if given, from the next tick on, without a step of the voltage.

        The derivative is scaled to the new KD. The integrator takes up all other changes before the filters. The state
        of the filters is set such that their next two outputs equal those of the old filters.

        Raises
        ------
        PkmError
            If the loop is unstable on the model of its axis; the message has the margin, the old gains stay.

        """
        model = self._model if model is None else model
        require_stable('new gains', gains, model, self._sample_time)
        self._model = model
        old_gains, old = self.gains, self._parameters
        self._take(gains)
        new, state = self._parameters, self._state
        before = after = 0.0
        if self._samples:
            before = self._feedforward_at(self._next)
            self._feedforward = self._sum_feedforward()
            after = self._feedforward_at(self._next)
        error = 0.0 if math.isnan(state[2]) else state[2]
        signal = (old[0] + old[1]) * error + state[0] + old[3] * state[1] + before
        wanted = signal * old_gains.lag.dc_gain / gains.lag.dc_gain
        state[1] *= gains.kd / old_gains.kd if old_gains.kd else 0.0
        state[0] = wanted - (new[0] + new[1]) * error - new[3] * state[1] - after
        outputs, inputs = np.array([signal, signal]), np.array([wanted, wanted])
        for begin in (0, 1):
            b, s = slice(5 + 5 * begin, 10 + 5 * begin), slice(3 + 2 * begin, 5 + 2 * begin)
            outputs, state[s] = _matching_stage(old[b], new[b], state[s], outputs, inputs)
            inputs = outputs


def _matching_stage(old, new, state, old_inputs, new_inputs):
    """Return the next two outputs of a filter and the state from which the new one has the same; inputs (2,) each."""

    def free(coefficients, inputs, first):
        """Return the contribution of the inputs and the first output to the two outputs, without the state."""
        b0, b1, _, a1, _ = coefficients
        return b0 * inputs[0], b0 * inputs[1] + b1 * inputs[0] - a1 * first

    first = state[0] + old[0] * old_inputs[0]
    outputs = np.array([first, state[1] + free(old, old_inputs, first)[1]])
    return outputs, outputs - free(new, new_inputs, first)
