"""
Computed torque control of the whole machine, thesis (7.13)-(7.17), (8.1)-(8.3).

    e = r - q
    a = rdd + KD ed + KP e + KI INT e,   ed = (e - e_previous)/Ts
    F = M(q) a + C(q, rd) + G(q) + B rd,   u = F / thrust per volt, saturated at +-limit

On a machine equal to its model, the error of every axis obeys s^3 + KD s^2 + KP s + KI independent of the others.
M, C, G are those of the nominal design. The identified extra mass of an axis is added to its slider; B is its viscous
friction. C and B use the rates of the reference, because the difference of two counts has a resolution of 0.4 mm/s.
Anti-windup: the integrator is frozen while u is saturated and e would drive it further.

The thesis leaves out B, which costs an error of B rd/(M KP), and the delay dl of the loop. Here rd and rdd are taken
dl later, rd + dl rdd and rdd + dl rddd. The jerk term of the robust law does the same, which makes the two comparable.
The M of the thesis has the masses of the design, below the identified ones. `model: design` in the gains of an axis
gives the structure of the thesis, without these three.
"""

from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field

from pkm_core.config import Config, Frequency, Number, load_config
from pkm_core.control.feasibility import drive_check
from pkm_core.control.margins import require_stable
from pkm_core.control.model import in_joint_order, load_model
from pkm_core.control.pid import Pid
from pkm_core.errors import PkmError


class TorqueGains(Config):
    """Error dynamics of one axis: KP = wn^2, KD = 2 zeta wn, KI = `integral` KD KP; stable for `integral` below 1."""

    natural_frequency: Annotated[Frequency, Field(gt=0, description='wn/(2 pi)')]
    damping: Annotated[Number, Field(gt=0, description='zeta')]
    integral: Annotated[Number, Field(ge=0, lt=1, description='KI/(KD KP)')]
    model: Annotated[
        Literal['identified', 'design'],
        Field(description='design, as in the thesis: without identified mass, viscous friction and delay of the loop'),
    ] = 'identified'

    def error_gains(self):
        """Return KP [1/s^2], KI [1/s^3], KD [1/s]."""
        wn = 2 * np.pi * self.natural_frequency
        kp, kd = wn**2, 2 * self.damping * wn
        return kp, self.integral * kp * kd, kd

    def pid(self, model):
        """
        Return the equivalent `Pid` [V, m] of a single axis with its `AxisModel`, all coupling cancelled.

        With `model` 'design' the loop gain is lower, by the share of the design in the identified mass.
        """
        kp, ki, kd = self.error_gains()
        return Pid(kp / model.gain, ki / model.gain, kd / model.gain)


class TorqueControlFile(Config):
    """Gains of computed torque."""

    joints: dict[str, TorqueGains]


def load_torque_control(machine, name_or_path=None):
    """Return {joint: TorqueGains} of config/control/computed_torque; default and errors as `robust.load_control`."""
    path = machine.configuration.find('control/computed_torque', name_or_path or machine.name)
    gains = in_joint_order(machine, load_config(path, TorqueControlFile).joints, path)
    for joint, model in load_model(machine).items():
        require_stable(f'{path}: {joint}', gains[joint].pid(model), model, machine.sample_time)
    return gains


@njit(cache=True)
def _step(error, acceleration, velocity, learned, M, C, G, gains, newton_per_volt, limit, state, voltage):
    """Advance `state` (2, n) = (integral of e, previous e) by one tick and fill `voltage` (n,); gains: __init__."""
    n = error.size
    wanted, integral = np.empty(n), np.empty(n)
    for i in range(n):
        kp, ki_ts, kd_over_ts = gains[0, i], gains[1, i], gains[2, i]
        previous = error[i] if np.isnan(state[1, i]) else state[1, i]
        integral[i] = state[0, i] + ki_ts * error[i]
        wanted[i] = acceleration[i] + kd_over_ts * (error[i] - previous) + kp * error[i] + integral[i]
        state[1, i] = error[i]
    for i in range(n):
        thrust = C[i] + G[i] + gains[3, i] * wanted[i] + gains[4, i] * velocity[i]
        for j in range(n):
            thrust += M[i, j] * wanted[j]
        signal = thrust / newton_per_volt + learned[i]
        voltage[i] = min(max(signal, -limit), limit)
        if voltage[i] == signal or error[i] * signal <= 0.0:
            state[0, i] = integral[i]


class ComputedTorque:
    """
    The controller of all joints, with the interface of controllers.py.

    Parameters
    ----------
    machine : Machine
    gains : dict of str to TorqueGains
        Of `load_torque_control`, in the order of the joints.
    models : dict of str to AxisModel
        Of `load_model`, in the same order.

    """

    def __init__(self, machine, gains, models):
        self._machine, self._check = machine, drive_check(machine, models)
        kp, ki, kd = np.array([axis.error_gains() for axis in gains.values()]).T
        mass = machine.thrust_per_volt / np.array([model.gain for model in models.values()])
        viscous = mass * [model.viscosity for model in models.values()]
        added = mass - np.diag(machine.mass_matrix(machine.home))
        known = np.array([axis.model == 'identified' for axis in gains.values()], dtype=float)
        self._gains = np.array([kp, ki * machine.sample_time, kd / machine.sample_time, known * added, known * viscous])
        delay = [1.5 * machine.sample_time + model.low_frequency_delay() for model in models.values()]
        self._delay = known * np.array(delay)
        self._design = machine.dynamic_parameters()
        n = len(machine.joints)
        self._M, self._C, self._G = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        self._state = np.empty((2, n))
        self.reset()
        # numba compiles or loads its cache at the first call: here, not in the first tick
        self._voltage(machine.home, *np.zeros((4, n)), self._state.copy())

    def reset(self):
        """Return to the initial state: no cycle is loaded and the machine is assumed to be at rest."""
        self._state[0], self._state[1] = 0.0, np.nan
        self._samples = 0

    def load(self, trajectory, learned):
        """
        Load the joint trajectory of one cycle and its learned voltage (N, n) [V], which is added to u.

        `PkmError` if shapes differ or a value is not finite, or a drive cannot follow it by its model.
        """
        learned = np.array(learned, dtype=np.float64)
        if trajectory.coordinates != self._machine.joints or learned.shape != trajectory.position.shape:
            raise PkmError(
                f'cycle: trajectory of {trajectory.coordinates} {trajectory.position.shape}, learned {learned.shape}; '
                f'expected {self._machine.joints} and equal shapes'
            )
        if not np.isfinite(learned).all():
            raise PkmError(f'cycle: learned is not finite at sample {np.argwhere(~np.isfinite(learned))[0][0]}')
        self._check(trajectory)
        position, velocity, acceleration, jerk = trajectory.derivatives()
        self._samples, self._position, self._learned = len(trajectory), position, learned
        self._velocity, self._acceleration = velocity + self._delay * acceleration, acceleration + self._delay * jerk

    def check(self, trajectory):
        """Raise `PkmError` if a drive cannot follow a joint trajectory by its model."""
        self._check(trajectory)

    def extend(self, offset, position, velocity, acceleration, jerk):
        """Replace the running cycle from sample `offset` on by rows (M, n), without learned voltage."""
        new = velocity + self._delay * acceleration, acceleration + self._delay * jerk, np.zeros_like(position)
        old = self._velocity, self._acceleration, self._learned
        joined = (np.concatenate([before[:offset], rows]) for before, rows in zip(old, new, strict=True))
        self._velocity, self._acceleration, self._learned = joined
        self._position = np.concatenate([self._position[:offset], position])
        self._samples = len(self._position)

    def update(self, index, measured):
        """Return voltages [V] and errors r - q [m], (n,) each, for sample `index` and `measured` positions (n,) [m]."""
        if not 0 <= index < self._samples:
            raise PkmError(f'sample {index}: the loaded cycle has {self._samples} samples, counted from 0')
        if not np.isfinite(measured).all():
            raise PkmError(f'sample {index}: measured positions are {measured}; expected finite numbers of metres')
        error = self._position[index] - measured
        rows = (each[index] for each in (self._velocity, self._acceleration, self._learned))
        return self._voltage(measured, error, *rows, self._state), error

    def _voltage(self, measured, error, velocity, acceleration, learned, state):
        machine, voltage = self._machine, np.empty(error.size)
        machine.terms(measured, velocity, self._design, self._M, self._C, self._G)
        _step(
            error, acceleration, velocity, learned, self._M, self._C, self._G, self._gains,
            machine.thrust_per_volt, machine.voltage_limit, state, voltage,
        )  # fmt: skip
        return voltage
