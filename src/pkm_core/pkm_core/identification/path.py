"""Joint trajectories of rests, moves and jogs at constant speed, with continuous jerk."""

import numpy as np

from pkm_core.motion.profiles import unit_profile
from pkm_core.motion.trajectory import SampledTrajectory


class Path:
    """
    A joint trajectory under construction; it starts at rest at the machine's home.

    Attributes
    ----------
    position : ndarray, shape (n,)
        Present end of the trajectory [m].
    samples : int
        Present length.

    """

    def __init__(self, machine):
        self._machine = machine
        self._pieces = []  # (position, velocity, acceleration, jerk), each (samples, n)
        self.position = machine.home.copy()
        self.samples = 0
        self._moves = []

    def rest(self, duration):
        """Stay for `duration` [s]."""
        self._add(duration, lambda s: (0 * s, 0 * s, 0 * s, 0 * s), 0 * self.position)

    def move(self, target, duration, *, listed=False):
        """Move from rest to rest at `target` (n,) [m] in `duration` [s]; a `listed` move is in the list of moves."""
        start = self.samples
        self._add(duration, lambda s: unit_profile('p7', s), target - self.position)
        self.position = target
        if listed:
            self._moves.append((start, self.samples))

    def change_speed(self, before, after, duration):
        """Change the velocity from `before` to `after`, (n,) [m/s], in `duration` [s]."""

        def shape(s):
            blend, slope, curve, _ = unit_profile('p7', s)
            return s**5 * (7 - s * (14 - s * (10 - s * 2.5))), blend, slope, curve  # the first is the integral of blend

        self._add(duration, shape, duration * (after - before), drift=before)
        self.position = self.position + 0.5 * duration * (before + after)

    def cruise(self, velocity, duration):
        """Hold `velocity` (n,) [m/s] for `duration` [s]; return (first sample, first sample after it)."""
        start = self.samples
        self._add(duration, lambda s: (0 * s, 0 * s, 0 * s, 0 * s), 0 * velocity, drift=velocity)
        self.position = self.position + velocity * (self.samples - start) * self._machine.sample_time
        return start, self.samples

    def trajectory(self):
        """Return the `SampledTrajectory` in joints; without listed moves the whole is one move."""
        columns = [np.concatenate(column) for column in zip(*self._pieces, strict=True)]
        starts, ends = np.array(self._moves or [(0, self.samples - 1)]).T
        return SampledTrajectory(self._machine.sample_time, self._machine.joints, *columns, starts, ends)

    def _add(self, duration, shape, step, drift=0.0):
        """Append position + drift t + shape step; `shape` returns a function of t/duration with its derivatives."""
        count = round(duration / self._machine.sample_time)
        s = np.arange(count) / count
        rows = [
            column[:, np.newaxis] * step / duration**order + 0 * self.position for order, column in enumerate(shape(s))
        ]
        rows[0] += self.position + (s * duration)[:, np.newaxis] * drift
        rows[1] += drift
        self._pieces.append(rows)
        self.samples += count
