"""Bounds of an excited axis, checked at every tick."""

from collections import deque
from dataclasses import dataclass

from pkm_core.control.feasibility import drive_limit

_MEMORY = 8  # [samples] span of the speed measurement; one count is then 0.05 mm/s
_FORECAST = 1.5  # allowed over forecast: margin for the error of the model
_SPARE_VOLTAGE = 1.0  # [V] for friction, coupling and noise
_SPARE_SPEED = 0.05  # [m/s]


@dataclass(frozen=True)
class Bounds:
    """Bounds of an axis during its excitation."""

    lower: float  # [m]
    upper: float  # [m]
    voltage: float  # [V]
    speed: float  # [m/s]
    deviation: float = 1e-3  # [m] from the reference

    @classmethod
    def around(cls, machine, joint, voltage, speed):
        """Return the bounds of an axis for the largest forecast `voltage` [V] and `speed` [m/s]."""
        axis = machine.joints.index(joint)
        return cls(
            lower=float(machine.limits.lower[axis]),
            upper=float(machine.limits.upper[axis]),
            voltage=min(_FORECAST * voltage + _SPARE_VOLTAGE, drive_limit(machine)),
            speed=min(_FORECAST * speed + _SPARE_SPEED, machine.limits.speed),
        )


class Guard:
    """Check of one axis against its `Bounds` at every tick."""

    def __init__(self, joint, bounds, sample_time):
        self._joint, self._bounds = joint, bounds
        self._past = deque(maxlen=_MEMORY + 1)
        self._span = _MEMORY * sample_time

    def check(self, index, voltage, position, reference):
        """
        Return the reason to stop the axis at sample `index`, '' without one.

        `voltage` [V] is that of the drive, with the excitation; `position` and `reference` are in m.
        """
        bounds, past = self._bounds, self._past
        past.append(position)
        speed = (position - past[0]) / self._span if len(past) > _MEMORY else 0.0
        if not bounds.lower <= position <= bounds.upper:
            what = f'is at {1e3 * position:.3f} mm; allowed {1e3 * bounds.lower:g} to {1e3 * bounds.upper:g} mm'
        elif not abs(position - reference) <= bounds.deviation:
            off = 1e3 * (position - reference)
            what = f'is {off:.3f} mm off its reference; allowed {1e3 * bounds.deviation:g} mm'
        elif not abs(speed) <= bounds.speed:
            what = f'moves at {speed:.3f} m/s; allowed {bounds.speed:.3f} m/s'
        elif not abs(voltage) <= bounds.voltage:
            what = f'gets {voltage:.2f} V; allowed {bounds.voltage:.2f} V'
        else:
            return ''
        return f'sample {index}: {self._joint} {what}'
