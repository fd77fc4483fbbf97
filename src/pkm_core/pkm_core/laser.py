"""
Laser measurement of the end point, independent of the encoders: own clock, own resolution, own noise.

The thesis's Tables 7.3 and 8.3 imply 0.8 ms and 0.91 um: settling times and errors come in these steps. It sees what
the encoders cannot: link errors, offsets of the reference marks, the bend of the belts.
"""

import math
from typing import NamedTuple

import numpy as np

from pkm_core.errors import PkmError
from pkm_core.machines.checks import ANGLES
from pkm_core.noise import laser_noise
from pkm_core.truth import load_truth


class LaserSample(NamedTuple):
    """One measurement."""

    time: float  # since the machine was switched on [s]
    displacement: np.ndarray  # (m,) of the pose from the datum, in the machine's coordinates [m, rad]


class Laser:
    """
    The measurement system set up at one machine.

    Parameters
    ----------
    machine : Machine
    seed : int
        That of the plant.
    environment : str
        That of the plant.

    """

    def __init__(self, machine, seed, environment='nominal'):
        truth, levels = load_truth(machine, environment)
        angular = [coordinate in ANGLES for coordinate in machine.coordinates]
        scale = np.where(angular, 1.0 / truth.laser.rotation_arm, 1.0)  # a rotation is read as a displacement on an arm
        self._step = truth.laser.resolution * scale
        self._noise = levels.laser_noise * scale
        self._sample_time = truth.laser.sample_time
        self._seed = seed
        self._last = None
        self._datum = None
        self._number = 0

    def zero(self, truth):
        """Take the end point of `truth` (a PlantTruth) as the datum and measure on from its time."""
        self._datum = truth.pose
        self._last = truth
        self._number = math.ceil(truth.time / self._sample_time)

    def observe(self, truth):
        """
        Return the `LaserSample` that fell since the last call, or None; to be called once a tick with plant.truth.

        The first call sets the datum. Between ticks the joints are followed by a cubic through positions and speeds.
        """
        if self._last is None:
            self.zero(truth)
            return None
        duration = truth.time - self._last.time
        if duration <= 0.0:
            raise PkmError(f'laser: {truth.time:g} s given after {self._last.time:g} s; after a reset call zero')
        before, self._last = self._last, truth
        due = self._number * self._sample_time
        if due > truth.time:
            return None
        share = (due - before.time) / duration
        q = _between(before.q, before.qd, truth.q, truth.qd, duration, share)
        belts = _between(before.belts, before.belt_rates, truth.belts, truth.belt_rates, duration, share)
        noise = self._noise * laser_noise(self._seed, self._number, self._noise.size)
        displacement = truth.assembly.end_point(q, belts) - self._datum + noise
        self._number += 1
        return LaserSample(due, self._step * np.round(displacement / self._step))


def _between(start, start_rate, end, end_rate, duration, share):
    """Return the cubic Hermite interpolant at `share` in 0..1 of `duration`."""
    rest = 1.0 - share
    return (
        rest**2 * (1.0 + 2.0 * share) * start
        + share**2 * (1.0 + 2.0 * rest) * end
        + duration * share * rest * (rest * start_rate - share * end_rate)
    )
