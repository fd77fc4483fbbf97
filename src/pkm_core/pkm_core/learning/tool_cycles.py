"""Measurements of the last cycles, gathered until learning at the tool can use them."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from pkm_core.errors import LearningError
from pkm_core.machines.laser_clock import nanoseconds

_KEPT = 4  # cycles; those before are never asked for
_MOST_SAMPLES = 100_000  # of the laser: 80 s, several times the longest cycle


@dataclass
class _Cycle:
    """What is known of one cycle."""

    errors: dict = field(default_factory=dict)  # (N,) [m] by joint
    position: np.ndarray | None = None  # (N, n) [m] reference that the controllers were given
    end: tuple[int, int] | None = None  # tick after the last one, samples
    failed: bool = False


class ToolCycles:
    """
    Gathers laser samples, errors and events, in any order.

    Parameters
    ----------
    machine : Machine

    """

    def __init__(self, machine):
        self._joints = machine.joints
        self._tick, self._laser = nanoseconds(machine.sample_time), nanoseconds(machine.laser_sample_time)
        self._cycles = {}
        self._samples = deque(maxlen=_MOST_SAMPLES)  # (time, displacement...)

    def sample(self, sample):
        """Take a sample of the laser, (time [s], *displacement [m, rad])."""
        self._samples.append(sample)

    def error(self, cycle, joint, error):
        """Take the errors (N,) [m] of one joint."""
        self._of(cycle).errors[joint] = np.array(error, dtype=np.float64)

    def reference(self, cycle, position):
        """Take the reference (N, n) [m] that was published for the cycle."""
        self._of(cycle).position = position

    def finished(self, cycle, tick, samples):
        """Take the end of a cycle: the tick after its last one, and its number of samples."""
        self._of(cycle).end = tick, samples

    def failed(self, cycle):
        """Take the end of a cycle that was refused or ended in a fault."""
        self._of(cycle).failed = True

    def has_failed(self, cycle):
        """Return whether the cycle was refused or ended in a fault."""
        return self._of(cycle).failed

    def missing(self, cycle, laser=True):
        """Return what is missing for learning from `cycle`, a list of names; with `laser` its samples count."""
        known = self._of(cycle)
        lacking = [f'the errors of {joint}' for joint in self._joints if joint not in known.errors]
        if known.position is None:
            lacking.append('the joint_trajectory')
        if known.end is None:
            return [*lacking, 'its end']
        newest = self._samples[-1][0] * 1e9 if self._samples else -np.inf
        if laser and newest + self._laser < known.end[0] * self._tick - 1:
            lacking.append('samples of the laser')
        return lacking

    def has_run(self, cycle, position):
        """Return whether the controllers were given the reference `position` (N, n) in `cycle`."""
        return np.array_equal(self._of(cycle).position, position)

    def take(self, cycle):
        """
        Return the arguments of `ToolLearning.after_cycle` for a cycle without missing errors and end.

        Samples before its end are dropped. `LearningError` if the joints have different numbers of errors.
        """
        known = self._of(cycle)
        tick, samples = known.end
        first, end = (tick - samples) * self._tick, tick * self._tick
        within, later = [], []
        for sample in self._samples:
            nanosecond = round(sample[0] * 1e9) if np.isfinite(sample[0]) else first
            if nanosecond >= end:
                later.append(sample)
            elif nanosecond >= first:
                within.append(sample)
        self._samples = deque(later, maxlen=_MOST_SAMPLES)
        lengths = {joint: len(known.errors[joint]) for joint in self._joints}
        if len(set(lengths.values())) > 1:
            raise LearningError(f'encoder errors of cycle {cycle}: {lengths} values; expected equal numbers')
        rows = np.array(within, dtype=np.float64)
        error = np.stack([known.errors[joint] for joint in self._joints], axis=1)
        return error, tick - samples, *((rows[:, 0], rows[:, 1:]) if within else (rows, rows.reshape(0, 0)))

    def _of(self, cycle):
        if cycle not in self._cycles:
            self._cycles[cycle] = _Cycle()
            for old in list(self._cycles)[:-_KEPT]:
                del self._cycles[old]
        return self._cycles[cycle]
