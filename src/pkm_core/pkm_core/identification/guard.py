"""The watch over an axis while it is excited: one check a tick, a text when it must be stopped."""

from collections import deque
from dataclasses import dataclass

from pkm_core.identification.axis_data import drive_limit

_MEMORY = 8  # samples over which speed is measured; a count then is 0.05 mm/s
_FORECAST = 1.5  # an unknown machine may do that much more than its model says
_SPARE_VOLTAGE = 1.0  # V, for friction, coupling and noise
_SPARE_SPEED = 0.05  # m/s


@dataclass(frozen=True)
class Bounds:
    """What an axis must keep while it is excited."""

    lower: float  # [m]
    upper: float  # [m]
    voltage: float  # [V]
    speed: float  # [m/s]
    deviation: float = 1e-3  # [m] from the reference

    @classmethod
    def around(cls, machine, joint, voltage, speed):
        """Return the bounds for an axis of which `voltage` [V] and `speed` [m/s] are forecast at most."""
        axis = machine.joints.index(joint)
        return cls(
            lower=float(machine.limits.lower[axis]),
            upper=float(machine.limits.upper[axis]),
            voltage=min(_FORECAST * voltage + _SPARE_VOLTAGE, drive_limit(machine)),
            speed=min(_FORECAST * speed + _SPARE_SPEED, machine.limits.speed),
        )


class Guard:
    """Checks one axis tick by tick against its `Bounds`."""

    def __init__(self, joint, bounds, sample_time):
        self._joint, self._bounds = joint, bounds
        self._past = deque(maxlen=_MEMORY + 1)
        self._span = _MEMORY * sample_time

    def check(self, index, voltage, position, reference):
        """
        Return '' or, as text, why the axis must be stopped at sample `index`.

        `voltage` [V] is what goes to the drive, excitation included; `position` and `reference` are in m.
        """
        bounds, past = self._bounds, self._past
        past.append(position)
        speed = (position - past[0]) / self._span if len(past) > _MEMORY else 0.0
        if not bounds.lower <= position <= bounds.upper:
            what = f'stands at {1e3 * position:.3f} mm; travel is {1e3 * bounds.lower:g} to {1e3 * bounds.upper:g} mm'
        elif not abs(position - reference) <= bounds.deviation:
            off = 1e3 * (position - reference)
            what = f'is {off:.3f} mm off its reference; allowed {1e3 * bounds.deviation:g} mm'
        elif not abs(speed) <= bounds.speed:
            what = f'moves at {speed:.3f} m/s; allowed {bounds.speed:.3f} m/s'
        elif not abs(voltage) <= bounds.voltage:
            what = f'is sent {voltage:.2f} V; allowed {bounds.voltage:.2f} V'
        else:
            return ''
        return f'sample {index}: {self._joint} {what}'
