"""
Temperatures of one machine and what they change: lengths, scales, resistance and force constant of the motors.

The nodes are, for each joint, the motor with its carriage, the link on it, and the scale with its guide; then one for
upper links, platforms and end-effector. With the rise T over ambient, the temperature of calibration,

    C_i T_i' = P_i - G_i T_i - SUM_j G_ij (T_i - T_j),
    P_motor = 3/4 R (1 + copper T) I^2 + (1 - s) F v,   P_scale = s F v,

I the amplitude of the phase currents, R phase to phase, F v the power of friction. The solution for constant I^2 and
F v is exact for any duration. The plant updates T at the start of a cycle; T is constant within a cycle.
"""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from scipy.linalg import expm

from pkm_core.errors import ConfigError, PkmError

_LINK_ON = {'four_dof': ('l2', 'l4', 'l6', 'l8'), 'planar': ('l2', 'l4')}  # by joint
_HIGHEST = 200.0  # [K] of a rise given at power-up; chosen: coils are insulated for less


class Heat:
    """
    Temperatures of the `Assembly` `cold` of `machine`.

    Parameters
    ----------
    machine : Machine
    drive : truth.Drive
    levels : heat_levels.HeatLevels
    cold : Assembly
        At ambient temperature.
    rise : array_like, shape (3 n + 1,), optional
        Temperatures over ambient at power-up [K], in the order of `nodes`; by default zero.

    Attributes
    ----------
    nodes : tuple of str
    rise : ndarray, shape (3 n + 1,)
        Present temperatures over ambient [K].
    losses, no_losses : tuple
        Arguments (square, friction) of `pass_time`: of the ticks last taken, and zeros.

    Raises
    ------
    ConfigError
        If the machine has no links.
    PkmError
        If `rise` is refused.

    """

    def __init__(self, machine, drive, levels, cold, rise=None):
        if cold.mechanism not in _LINK_ON:
            raise ConfigError(f'truth of {machine.name}: heat given; a {cold.mechanism} has no links')
        joints = machine.joints
        self.nodes = (*(f'{kind} {joint}' for kind in ('motor', 'link', 'scale') for joint in joints), 'platform')
        self._size, self._levels, self._cold = len(joints), levels, cold
        self._start = _checked(np.zeros(len(self.nodes)) if rise is None else rise, self.nodes)
        self._ohm = 0.75 * drive.resistance
        self._capacity, self._conductance = _network(len(joints), levels)
        self._sample_time, self.no_losses = machine.sample_time, (np.zeros(len(joints)), np.zeros(len(joints)))
        self.reset()

    def reset(self):
        """Return to the temperatures of power-up."""
        self.rise = self._start.copy()
        self.losses, self._ticks = self.no_losses, 0

    def take_losses(self, axes, ticks):
        """
        Advance over the ticks since the last call, with the means of the losses summed in `axes`; set the sums to 0.

        `axes` are those of arrays.PlantArrays, `ticks` is counted from `reset`.
        """
        if passed := ticks - self._ticks:
            self.losses = axes['square'] / passed, axes['rubbing'] / passed
            self.pass_time(passed * self._sample_time, *self.losses)
        axes['square'] = axes['rubbing'] = 0.0
        self._ticks = ticks

    def pass_time(self, seconds, square, friction):
        """
        Advance the temperatures, exactly for constant losses.

        Parameters
        ----------
        seconds : float
            Duration [s].
        square : ndarray, shape (n,)
            Mean square of the amplitude of the phase currents [A^2].
        friction : ndarray, shape (n,)
            Mean power of friction [W].

        """
        n, size, levels = self._size, len(self.rise), self._levels
        copper = self._ohm * square
        power = np.zeros(size)
        power[:n] = copper + (1.0 - levels.friction_to_scale) * friction
        power[2 * n : 3 * n] = levels.friction_to_scale * friction
        system = np.zeros((size + 1, size + 1))
        system[:size, :size] = -self._conductance
        system[range(n), range(n)] += levels.copper * copper
        system[:size, size] = power
        system[:size] /= self._capacity[:, np.newaxis]
        step = expm(system * seconds)
        self.rise = step[:size, :size] @ self.rise + step[:size, size]

    def apply(self, arrays, built):
        """
        Set the motors in `arrays` from those `built` at ambient temperature; the force constants are multiplied.

        Magnets have the temperature of their coil. All windings have one resistance and brake force: of the mean motor.
        """
        motors = self.rise[: self._size]
        force = 1.0 + self._levels.magnets * motors
        resistance = 1.0 + self._levels.copper * float(motors.mean())
        arrays.parameters['newton_per_ampere'] *= force
        common, cold = arrays.common, built.common
        for name in ('emf_damping', 'brake_damping'):
            common[name] = cold[name] * (float(force.mean()) ** 2 / resistance)
        common['winding'] = cold['winding'] / resistance
        common['decay_winding'] = math.exp(-common['substep'][0] / common['winding'][0])

    def assembly(self):
        """Return the `Assembly` with the present lengths and scales."""
        n, cold, levels = self._size, self._cold, self._levels
        links = dict(zip(_LINK_ON[cold.mechanism], self.rise[n : 2 * n], strict=True))
        lengths = {
            name: float(length * (1.0 + levels.links_expand * links.get(name, self.rise[-1])))
            for name, length in cold.lengths.items()
        }
        longer = 1.0 + levels.links_expand * self.rise[-1]
        named = [name for name in ('dx', 'dy', 'dz') if hasattr(cold.offsets, name)]
        offsets = SimpleNamespace(**{name: float(longer * getattr(cold.offsets, name)) for name in named})
        own = 0.0 if cold.scale is None else cold.scale
        scale = own + (1.0 + own) * levels.scales_expand * self.rise[2 * n : 3 * n]  # a longer scale reads less
        return replace(cold, lengths=lengths, offsets=offsets, scale=scale)


def _network(n, levels):
    """Return capacities (3 n + 1,) [J/K] and the symmetric conductances (3 n + 1, 3 n + 1) [W/K] of the balance."""
    each = [levels.motors] * n + [levels.links] * n + [levels.scales] * n + [levels.platform]
    G = np.diag([node.to_ambient for node in each])
    for i in range(n):
        ways = ((i, n + i, levels.motor_to_link), (i, 2 * n + i, levels.motor_to_scale),
                (n + i, 3 * n, levels.link_to_platform))  # fmt: skip
        for a, b, way in ways:
            G[a, a] += way
            G[b, b] += way
            G[a, b] -= way
            G[b, a] -= way
    return np.array([node.capacity for node in each]), G


def _checked(rise, nodes):
    rise = np.array(rise, dtype=float)
    if rise.shape != (len(nodes),) or not (np.abs(rise) <= _HIGHEST).all():
        raise PkmError(f'plant: rise {rise.tolist()} K given; allowed: {len(nodes)} values of at most {_HIGHEST:g} K')
    return rise
