"""Input of a fit: the data of one axis, and the record of all joints from which it is taken."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pkm_core.control.feasibility import drive_limit
from pkm_core.identification import IdentificationError
from pkm_core.identification.coupling import reaction_voltage

_FOLLOWS = 0.5  # least range of motion over that of the reference; any closed loop is close to 1


@dataclass(frozen=True)
class AxisData:
    """
    Drive voltage and position of one axis, sampled evenly.

    Arrays of different lengths and values that are not finite raise an `IdentificationError`. For an axis of another
    machine, [V] and [m] stand for the units of its drive and its sensor.
    """

    name: str  # source of the data, for messages
    sample_time: float  # [s]
    voltage: np.ndarray  # (N,) sent to the drive [V]; acts `computation` samples later
    position: np.ndarray  # (N,) [m]
    reference: np.ndarray | None = None  # (N,) reference position [m]; free of noise, hence usable as an instrument
    excitation: np.ndarray | None = None  # (N,) voltage added to that of the controller [V]
    reaction: np.ndarray | None = None  # (N,) voltage spent on the reaction of the other axes [V], `reaction_voltage`
    moves: tuple[tuple[int, int], ...] = ()  # (start, end) samples of rest-to-rest moves; () if unknown
    limit: float = np.inf  # saturation of the drive [V]
    computation: int = 1  # whole samples from the reading of a position to the voltage computed from it

    def __post_init__(self):
        samples = len(self.position)
        if samples == 0:
            raise IdentificationError(f'{self.name}: 0 samples; at least 1 is needed')
        for name in ('voltage', 'position', 'reference', 'excitation', 'reaction'):
            values = getattr(self, name)
            if values is None:
                continue
            if np.shape(values) != (samples,):
                raise IdentificationError(f'{self.name}: {name} has shape {np.shape(values)}; expected ({samples},)')
            if not np.isfinite(values).all():
                index = int(np.argmin(np.isfinite(values)))
                raise IdentificationError(
                    f'{self.name}: {name} is {values[index]} at sample {index}; expected a finite number'
                )

    @cached_property
    def net_voltage(self):
        """The voltage (N,) that accelerates the axis itself: `voltage` less `reaction` [V]."""
        if self.reaction is None:
            return self.voltage
        ahead = self.computation  # a voltage acts over the sample that begins this much later
        acts = np.append(self.reaction[ahead:], np.repeat(self.reaction[-1], ahead + 1))
        return self.voltage - 0.5 * (acts[:-1] + acts[1:])

    def check_follows(self):
        """Raise `IdentificationError` if the reference moved and the axis did not."""
        moved, wanted = np.ptp(self.position), 0.0 if self.reference is None else np.ptp(self.reference)
        if moved < _FOLLOWS * wanted:
            raise IdentificationError(
                f'{self.name}: moved by {moved:.3g} m where its reference moved by {wanted:.3g} m; at least '
                f'{_FOLLOWS:g} of that is needed; check that the axis is enabled'
            )

    def saturated(self, start, end):
        """Return the number of voltage samples from `start` to `end` at the limit of the drive."""
        return int(np.count_nonzero(np.abs(self.voltage[start:end]) >= self.limit * (1 - 1e-6)))


@dataclass(frozen=True)
class JointRecord:
    """All joints of a machine over one cycle; arrays are (N, n): one row per tick, one column per joint."""

    name: str
    reference: np.ndarray  # [m]
    counts: np.ndarray  # int64
    voltage: np.ndarray  # [V] sent to the drives, excitation included
    excitation: np.ndarray | None = None  # [V]; None if there was none
    moves: tuple[tuple[int, int], ...] = ()  # (start, end) samples of the moves to which L is fitted

    def axis(self, machine, joint):
        """Return the `AxisData` of `joint`."""
        axis = joint_number(machine, joint)
        return AxisData(
            name=f'{self.name}: {joint}',
            sample_time=machine.sample_time,
            voltage=self.voltage[:, axis],
            position=self.counts[:, axis] * machine.encoder_resolution,
            reference=self.reference[:, axis],
            excitation=None if self.excitation is None else self.excitation[:, axis],
            reaction=reaction_voltage(machine, self.reference, axis),
            moves=self.moves,
            limit=drive_limit(machine),
        )

    def excites(self, machine, joint):
        """Return whether `joint` was excited."""
        return self.excitation is not None and bool(self.excitation[:, joint_number(machine, joint)].any())

    def moves_plainly(self, machine, joint):
        """Return whether `joint` takes part in the moves and no joint was excited."""
        path = self.reference[:, joint_number(machine, joint)]
        moved = any(np.ptp(path[start:end]) > 0 for start, end in self.moves)
        return moved and (self.excitation is None or not self.excitation.any())

    def excited_position(self):
        """Return the mean joint positions (n,) [m] over the samples with an excitation."""
        return self.reference[np.any(self.excitation != 0, axis=1)].mean(axis=0)


def joint_number(machine, joint):
    """Return the index of `joint` in `machine.joints`; raise `IdentificationError` if it is unknown."""
    if joint not in machine.joints:
        raise IdentificationError(f'joint {joint!r} is unknown; {machine.name} has {list(machine.joints)}')
    return machine.joints.index(joint)
