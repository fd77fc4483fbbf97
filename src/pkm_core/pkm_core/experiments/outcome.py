"""Results of one condition with one noise seed by cycle, and the spread over cycles and seeds."""

from dataclasses import dataclass, fields

import numpy as np

from pkm_core.bag.cycle_record import CycleRecord
from pkm_core.experiments.condition import Condition
from pkm_core.motion.metrics import AxisMetrics
from pkm_core.reporting.histories import joint_histories, laser_histories

QUANTITIES = tuple(field.name for field in fields(AxisMetrics))


@dataclass(frozen=True)
class Outcome:
    """Figures of a run; arrays (cycles, axes) by quantity of `AxisMetrics` in m and s, nan: does not settle."""

    condition: Condition
    seed: int
    joints: tuple[str, ...]
    coordinates: tuple[str, ...]
    encoders: dict[str, np.ndarray]  # by the encoders; axes are the joints
    laser: dict[str, np.ndarray]  # by the laser; axes are the coordinates, rotations as displacement; {} without laser
    peak_voltage: float  # [V] of all joints over the counted cycles
    peak_power: float  # [W] thrust times speed, of all joints over the counted cycles
    notices: tuple[str, ...]
    shown: tuple[CycleRecord, CycleRecord]  # the first and the last cycle

    @property
    def counted(self):
        """Slice of the counted cycles."""
        return slice(self.condition.settled, None)


def outcome(condition, seed, records, notices, machine):
    """Return the `Outcome` of the `CycleRecord`s of a run on `machine`."""
    counted = records[condition.settled :]
    measured = [laser_histories(record) for record in records]
    thrust = [machine.thrust_per_volt * np.abs(record.voltage) for record in counted]
    speed = [np.abs(np.gradient(record.reference, record.sample_time, axis=0)) for record in counted]
    return Outcome(
        condition,
        seed,
        records[0].joints,
        records[0].coordinates,
        _stacked([joint_histories(record) for record in records]),
        {} if measured[0] is None else _stacked(measured),
        max(float(np.abs(record.voltage).max()) for record in counted),
        max(float((f * v).max()) for f, v in zip(thrust, speed, strict=True)),
        tuple(notices),
        (records[0], records[-1]),
    )


def _stacked(histories):
    metrics = [list(each.metrics().values()) for each in histories]
    return {name: np.array([[getattr(axis, name) for axis in cycle] for cycle in metrics]) for name in QUANTITIES}


@dataclass(frozen=True)
class Spread:
    """Mean, 95th percentile of the absolute value, and the share of cycles in which an axis does not settle."""

    mean: float  # inf if an axis does not settle in any cycle
    p95: float
    never: float


def spread(values, factor=1.0):
    """Return the `Spread` of `factor` times `values` of any shape; nan: does not settle."""
    never = np.isnan(values)
    values = np.where(never, np.inf, factor * values)
    p95 = np.percentile(np.abs(values), 95, method='higher')  # an actual value: inf cannot be interpolated
    return Spread(float(values.mean()), float(p95), float(never.mean()))


def counted(outcomes, source, quantity):
    """Return `quantity` by 'encoders' or 'laser' of all counted cycles of the `Outcome`s of a condition: (k, axes)."""
    return np.concatenate([getattr(each, source)[quantity][each.counted] for each in outcomes])


def worst_axis(outcomes, quantity='max_dynamic_error'):
    """Return `quantity` of the worst joint (seeds, cycles) over all cycles, counted or not."""
    return np.array([np.abs(each.encoders[quantity]).max(axis=1) for each in outcomes])
