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
from pkm_core.control.forces import CycleForces, feedforward
from pkm_core.control.margins import require_stable
from pkm_core.control.model import in_joint_order, load_model
from pkm_core.control.pid import PidLaw
from pkm_core.errors import PkmError


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


def feedforward_gains(gains, model, sample_time):
    """
    Return Kv [V s/m], Ka [V s^2/m], Kj [V s^3/m] of (7.24): the inverse of K exp(-s dl)/(s (s + a)) to third order.

    dl is the sum of the delays of slow signals: computation and hold (1.5 Ts), current loop, modes, lag and notch.
    """
    delay = 1.5 * sample_time + model.low_frequency_delay()
    for stage in gains.stages:
        delay += filters.low_frequency_delay(stage.discrete(sample_time), sample_time)
    whole = model.gain * gains.lag.dc_gain  # the gain of the notch at rest is 1
    return model.viscosity / whole, (1 + model.viscosity * delay) / whole, delay / whole


@njit(cache=True)
def step(index, measured, reference, feedforward, parameters, state):
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
    if voltage != signal:
        state[7] += 1.0
    if voltage == signal or error * signal <= 0.0:
        state[0] = integral
    state[1] = derivative
    state[2] = error
    return voltage, error


class RobustController:
    """
    The controller of one axis: `load` a cycle, then `update` once per tick.

    Loading the next cycle replaces reference and feedforward; integrator, derivative and filters keep their state. The
    integrator takes up the step between the two feedforwards, which keeps the voltage continuous at the boundary. (A
    learned feedforward changes its level in every cycle; without this, the step moved a resting slider by 2 um for
    20 ms.)

    Parameters
    ----------
    gains : RobustGains
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
        self._state = np.empty(8)  # integral, derivative, previous error, lag (2), notch (2), samples at the limit
        self.reset()
        # numba compiles or loads its cache at the first call: here, not in the first tick
        step(0, 0.0, np.zeros(1), np.zeros(1), self._parameters, self._state.copy())

    def _take(self, gains):
        self.gains = gains
        self.feedforward_gains = feedforward_gains(gains, self._model, self._sample_time)
        carry = gains.derivative_filter / (gains.derivative_filter + self._sample_time)
        slope = gains.kd / (gains.derivative_filter + self._sample_time)
        self._parameters = np.array([
            *(gains.kp, gains.ki * self._sample_time, slope, carry, self._voltage_limit),
            *gains.lag.discrete(self._sample_time),
            *gains.notch.discrete(self._sample_time),
        ])  # fmt: skip

    def reset(self):
        """Return to the initial state: no cycle is loaded and the axis is assumed to be at rest."""
        self._state[:] = 0.0
        self._state[2] = np.nan  # no previous error: the first difference is zero
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
        self._state[0] += before - self._feedforward[0]
        self._samples, self._next, self._reference = samples, 0, rows[0]
        self._state[7] = 0.0

    def _sum_feedforward(self):
        """Return the feedforward (N,) [V] of the loaded cycle, and store its continuation after the cycle."""
        velocity, acceleration, jerk, learned = self._motion
        kv, ka, kj = self.feedforward_gains
        plain = kv * velocity + ka * acceleration + kj * jerk
        whole = plain + learned
        self._after = whole[0]  # cycles repeat: after its last sample the feedforward continues with its first one
        if self._model.forces is not None:
            added = feedforward(self._forces, plain, self.gains, self._model, self._sample_time)
            self._friction = self._forces.friction(self._model)[-1]
            self._after += added[-1]
            whole += added[:-1]
        return whole

    def _feedforward_at(self, index):
        """Return the feedforward [V] of sample `index`, up to the one after the last."""
        return self._feedforward[index] if index < self._samples else self._after

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

    @property
    def saturated(self):
        """The number of samples of the loaded cycle whose voltage was limited."""
        return int(self._state[7])

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
        return step(index, measured, self._reference, self._feedforward, self._parameters, self._state)


def _matching_stage(old, new, state, old_inputs, new_inputs):
    """Return the next two outputs of a filter and the state from which the new one has the same; inputs (2,) each."""

    def free(coefficients, inputs, first):
        """Return the contribution of the inputs and the first output to the two outputs, without the state."""
        b0, b1, _, a1, _ = coefficients
        return b0 * inputs[0], b0 * inputs[1] + b1 * inputs[0] - a1 * first

    first = state[0] + old[0] * old_inputs[0]
    outputs = np.array([first, state[1] + free(old, old_inputs, first)[1]])
    return outputs, outputs - free(new, new_inputs, first)
