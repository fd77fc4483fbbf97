"""One axis in an identification cycle: the excitation is checked before the cycle and monitored during it."""

import numpy as np

from pkm_core.control.feasibility import drive_limit
from pkm_core.identification import IdentificationError
from pkm_core.identification.guard import Bounds, Guard
from pkm_core.identification.sweep import forecast


class ExcitedAxis:
    """
    Excitation of one joint controller with the bounds at which the machine must stop.

    Parameters
    ----------
    machine : Machine
        Machine of the axis.
    joint : str
        Name of the joint.
    model : AxisModel
        Present model of the joint, for the forecast of voltage and speed.
    gains : RobustGains
        Gains of the joint during the cycle.
    position, velocity, acceleration : ndarray, shape (N,)
        Reference of the cycle [m, m/s, m/s^2].
    voltage : ndarray, shape (N,)
        Excitation [V]; all zero for an axis that is only monitored.

    Raises
    ------
    IdentificationError
        If the excitation has another length than the reference or a value that is not finite, or the axis would
        exceed its limit of voltage or speed.

    """

    def __init__(self, machine, joint, model, gains, position, velocity, acceleration, voltage):
        if voltage.shape != position.shape:
            raise IdentificationError(
                f'excitation of {joint}: {voltage.size} values; expected one per sample, {position.size}'
            )
        if not np.isfinite(voltage).all():
            index = int(np.argmin(np.isfinite(voltage)))
            raise IdentificationError(f'excitation of {joint}: {voltage[index]} V at sample {index}; expected finite')
        added, shaken = forecast(model, gains, voltage, machine.sample_time)
        needed = np.abs(acceleration + model.viscosity * velocity) / model.gain + np.abs(added)
        peak, fastest = float(needed.max()), float((np.abs(velocity) + np.abs(shaken)).max())
        limit, speed = drive_limit(machine), machine.limits.speed
        if peak > limit:
            raise IdentificationError(f'excitation of {joint}: would need {peak:.1f} V; allowed {limit:g} V')
        if fastest > speed:
            raise IdentificationError(f'excitation of {joint}: would move at {fastest:.3f} m/s; allowed {speed:g} m/s')
        self._guard = Guard(joint, Bounds.around(machine, joint, peak, fastest), machine.sample_time)
        self._reference, self._voltage, self._limit = position, voltage, machine.voltage_limit

    def drive(self, index, voltage, position):
        """
        Return the drive voltage [V] at sample `index`: `voltage` [V] of the controller plus the excitation, limited.

        Raises
        ------
        IdentificationError
            If the axis at `position` [m] is outside its bounds; the caller must stop the machine.

        """
        voltage = float(min(max(voltage + self._voltage[index], -self._limit), self._limit))
        reason = self._guard.check(index, voltage, position, self._reference[index])
        if reason:
            raise IdentificationError(reason)
        return voltage
