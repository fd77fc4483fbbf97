"""What a fit is made from: one axis over one record, and the record of all joints it is taken from."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pkm_core.identification import IdentificationError
from pkm_core.identification.coupling import reaction_voltage

_FOLLOWS = 0.5  # share of the reference's way; a loop that is closed at all does far better


@dataclass(frozen=True)
class AxisData:
    """
    One axis, sampled evenly: what it was told and where it was.

    Construction refuses what does not fit together or is not finite with an `IdentificationError`. Of somebody else's
    axis, [V] and [m] stand for the units of its drive and its sensor.
    """

    name: str  # for messages: where this comes from
    sample_time: float  # [s]
    voltage: np.ndarray  # (N,) sent to the drive [V]; acts `computation` samples later
    position: np.ndarray  # (N,) [m]
    reference: np.ndarray | None = None  # (N,) what it should have done [m]: free of noise, so an instrument
    excitation: np.ndarray | None = None  # (N,) what was added to the controller's voltage [V]
    reaction: np.ndarray | None = None  # (N,) what the other axes' motion costs this one [V], see `reaction_voltage`
    moves: tuple[tuple[int, int], ...] = ()  # (start, end) samples of rest-to-rest moves; () if unknown
    limit: float = np.inf  # the drive saturates there [V]
    computation: int = 1  # whole samples from reading a position to the voltage that answers it

    def __post_init__(self):
        samples = len(self.position)
        if samples == 0:
            raise IdentificationError(f'{self.name}: is empty: 0 samples')
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
        """What of the voltage is left to move the axis itself (N,) [V]."""
        if self.reaction is None:
            return self.voltage
        ahead = self.computation  # a voltage acts over the sample that begins so much later
        acts = np.append(self.reaction[ahead:], np.repeat(self.reaction[-1], ahead + 1))
        return self.voltage - 0.5 * (acts[:-1] + acts[1:])

    def check_follows(self):
        """Refuse a record in which the reference moved and the axis did not: `IdentificationError`."""
        moved, wanted = np.ptp(self.position), 0.0 if self.reference is None else np.ptp(self.reference)
        if moved < _FOLLOWS * wanted:
            raise IdentificationError(
                f'{self.name}: moved by {moved:.3g} m where its reference moved by {wanted:.3g} m; at least '
                f'{_FOLLOWS:g} of that is expected: is the axis enabled?'
            )

    def saturated(self, start, end):
        """Return how many samples of the voltage from `start` to `end` are at the drive's limit."""
        return int(np.count_nonzero(np.abs(self.voltage[start:end]) >= self.limit * (1 - 1e-6)))


@dataclass(frozen=True)
class JointRecord:
    """All joints of a machine over one cycle; arrays are (N, n): a row is a tick, a column a joint."""

    name: str
    reference: np.ndarray  # [m]
    counts: np.ndarray  # int64
    voltage: np.ndarray  # [V] sent to the drives, excitation included
    excitation: np.ndarray | None = None  # [V]; None if there was none
    moves: tuple[tuple[int, int], ...] = ()  # (start, end) samples of those L is fitted to

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
        """Return whether `joint` takes part in the moves and nothing was excited."""
        path = self.reference[:, joint_number(machine, joint)]
        moved = any(np.ptp(path[start:end]) > 0 for start, end in self.moves)
        return moved and (self.excitation is None or not self.excitation.any())

    def excited_position(self):
        """Return the mean joint positions (n,) [m] while anything was excited."""
        return self.reference[np.any(self.excitation != 0, axis=1)].mean(axis=0)


def joint_number(machine, joint):
    """Return which of the joints of `machine` is called `joint`; `IdentificationError` if none is."""
    if joint not in machine.joints:
        raise IdentificationError(f'joint {joint!r} is unknown; {machine.name} has {list(machine.joints)}')
    return machine.joints.index(joint)


def drive_limit(machine):
    """Return the voltage [V] beyond which a drive of `machine` gives no more thrust."""
    return min(machine.voltage_limit, machine.limits.thrust / machine.thrust_per_volt)
