"""
Laser measurement of the end point, independent of the encoders: own clock, own resolution, own noise.

The thesis's Tables 7.3 and 8.3 imply 0.8 ms and 0.91 um: settling times and errors are multiples of these steps. The
laser measures what the encoders do not: link errors, offsets of the reference marks, deflection of belts and platform.
Its axes are those of the machine, or those of the specimen if it has its own.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.errors import PkmError
from pkm_core.machines.checks import ANGLES
from pkm_core.machines.laser_clock import nanoseconds, sample_numbers
from pkm_core.plant.noise import LaserNoise
from pkm_core.plant.platform import Platform
from pkm_core.plant.truth import load_truth, platform_modes

_MOVED = np.array([0.0, 1e-5, -1e-5])  # s; central differences for speeds: moves of micrometres, rounding 1e-11 m/s


class LaserSamples(NamedTuple):
    """Consecutive measurements, one row per sample."""

    time: np.ndarray  # (K,) simulated time, 0 at tick 0 [s]
    displacement: np.ndarray  # (K, m) of the pose from the datum, in the machine's coordinates [m, rad]


class Laser:
    """
    The measurement system at one machine.

    Call `zero` at the first tick and `observe` at every further tick. `read` is the expensive call; one call may read
    many ticks.

    Parameters
    ----------
    machine : Machine
    seed : int
        Seed of the plant.
    environment : str
        Environment of the plant.

    """

    def __init__(self, machine, seed, environment='nominal'):
        truth, levels = load_truth(machine, environment)
        angular = [coordinate in ANGLES for coordinate in machine.coordinates]
        scale = np.where(angular, 1.0 / truth.laser.rotation_arm, 1.0)  # a rotation is measured as a displacement
        self._machine = machine
        self._step = truth.laser.resolution * scale
        self._scale = levels.laser_noise * scale
        self._noise = LaserNoise(seed, len(scale))
        self._modes = platform_modes(machine, truth, levels) if levels.modes else None
        self._skipped = 0  # number of samples that were due while the machine stood
        self._seen = []  # truths, one per tick
        self._tick = 0  # number of the first one

    def zero(self, tick, truth):
        """Take the end point of `truth` (a PlantTruth, at rest) at `tick` as the datum and start measuring."""
        self._datum = truth.pose
        self._platform = self._modes and Platform(self._modes, self._machine.sample_time)
        self._tick, self._seen = tick, [truth]

    def stand(self, ticks):
        """
        Let `ticks` pass without a measurement; the next one is the same as without them, but for its time.

        `ticks` is a multiple of the sample time of the laser, so that it keeps its phase.
        """
        self._skipped += len(sample_numbers(self._machine, self._tick, self._tick + ticks))
        self._tick += ticks

    def observe(self, tick, truth):
        """Store the true state of the machine at `tick`, which must follow the previous one."""
        expected = self._tick + len(self._seen)
        if not self._seen or tick != expected:
            raise PkmError(f'laser: tick {tick} given; expected {expected}; call zero at first and after a gap')
        self._seen.append(truth)

    def read(self):
        """
        Return the `LaserSamples` from the previous reading up to the last observed tick, that tick excluded.

        Between ticks the end point is a cubic through positions and speeds.
        """
        return self.read_with_truth()[0]

    def read_with_truth(self):
        """
        Return the `LaserSamples` as `read`, and the true displacement (T, m) [m, rad] at the ticks of the same time.

        The truth is for experiments that judge.
        """
        duration = self._machine.sample_time
        last = len(self._seen) - 1
        numbers = sample_numbers(self._machine, self._tick, self._tick + last)
        due = numbers * nanoseconds(self._machine.laser_sample_time)
        row, rest = np.divmod(due - self._tick * nanoseconds(duration), nanoseconds(duration))
        share = (rest / nanoseconds(duration))[:, np.newaxis]
        pose, rate = self._end_points()
        seen = _between(pose[row], rate[row], pose[row + 1], rate[row + 1], duration, share)
        displacement, axes = seen - self._datum, self._seen[-1].assembly.laser_axes
        if axes is not None:
            displacement = displacement @ axes.T
        displacement = displacement + self._scale * self._noise.at(numbers - self._skipped)
        self._tick, self._seen = self._tick + last, self._seen[-1:]
        samples = LaserSamples(due * 1e-9, self._step * np.round(displacement / self._step))
        return samples, pose[:-1] - self._datum

    def _end_points(self):
        """Return position and speed of the end point at each observed tick, two arrays (T, m)."""
        parts = ('q', 'qd', 'belts', 'belt_rates')
        q, qd, belts, rates = (np.array([getattr(truth, part) for truth in self._seen]) for part in parts)
        moved = _MOVED[:, np.newaxis, np.newaxis]  # one call for all three: its cost hardly depends on the rows
        assembly = self._seen[-1].assembly  # a new one at the start of a cycle is that of all ticks but the first
        pose, ahead, behind = assembly.end_point(q + moved * qd, belts + moved * rates)
        rate = (ahead - behind) / (_MOVED[1] - _MOVED[2])
        if self._platform:
            off, off_rate = self._platform.follow(rate)
            pose, rate = pose + off, rate + off_rate
        return pose, rate


def _between(start, start_rate, end, end_rate, duration, share):
    """Return the cubic Hermite interpolant at `share` in 0..1 of `duration`."""
    rest = 1.0 - share
    return (
        rest**2 * (1.0 + 2.0 * share) * start
        + share**2 * (1.0 + 2.0 * rest) * end
        + duration * share * rest * (rest * start_rate - share * end_rate)
    )
