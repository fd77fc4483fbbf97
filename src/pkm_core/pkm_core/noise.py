"""
What does not repeat: every draw of the simulated machine as a pure function of (seed, what, cycle, place in the cycle).

Counter-based generators make it so: nothing depends on how long other cycles were, how many there were, or on wall time.
"""

import numpy as np

from pkm_core.plant_arrays import AMPLIFIER, ENCODER, FLOOR

_ASSEMBLY, _CYCLE, _ENCODER, _AMPLIFIER, _FLOOR, _LASER = range(6)  # new streams go at the end: old seeds keep their bits
_BLOCK = 1024  # ticks drawn at once
_TONES = 24  # of the floor vibration, in each direction


def _generator(seed, *key):
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=key)))


def assembly_generator(seed):
    """Return the generator of what is fixed when a machine is built."""
    return _generator(seed, _ASSEMBLY)


def laser_noise(seed, sample, size):
    """Return the standard normal noise (size,) of the laser's sample number `sample`."""
    return _generator(seed, _LASER, sample).standard_normal(size)


class CycleNoise:
    """
    The disturbances of one cycle, drawn in blocks of ticks as they are needed.

    Attributes
    ----------
    block : ndarray, shape (3, ticks, n)
        The present block, rows plant_arrays.ENCODER [counts], AMPLIFIER [V], FLOOR [m/s^2]: the floor's acceleration
        along each guide.
    friction, gain : ndarray, shape (n,)
        Factors of this cycle on Coulomb friction and thrust.

    """

    def __init__(self, seed, levels, directions, band, sample_time):
        self._seed = seed
        self._levels = levels
        self._directions = [('x', 'y').index(direction) for direction in directions]
        self._band = band
        self._sample_time = sample_time
        self.start(0)

    def start(self, cycle):
        """Draw the factors of `cycle` and return to its first tick."""
        n, levels = len(self._directions), self._levels
        draw = _generator(self._seed, _CYCLE, cycle)
        self.friction = 1.0 + levels.friction_jitter * draw.uniform(-1.0, 1.0, n)
        self.gain = 1.0 + levels.gain_jitter * draw.standard_normal(n)
        tones = _generator(self._seed, _FLOOR, cycle)
        self._rates = 2.0 * np.pi * tones.uniform(*self._band, (_TONES, 2))
        self._phases = tones.uniform(0.0, 2.0 * np.pi, (_TONES, 2))
        self._cycle = cycle
        self._fill(0)

    def row(self, index):
        """Return the row of the block that belongs to tick `index` of the cycle; draws its block if it is another."""
        number, row = divmod(index, _BLOCK)
        if number != self._number:
            self._fill(number)
        return row

    def _fill(self, number):
        n = len(self._directions)
        levels, key = self._levels, (self._cycle, number)
        self._number = number
        self.block = np.zeros((3, _BLOCK, n))
        self.block[ENCODER] = levels.encoder_noise * _generator(self._seed, _ENCODER, *key).uniform(-1.0, 1.0, (_BLOCK, n))
        self.block[AMPLIFIER] = levels.amplifier_noise * _generator(self._seed, _AMPLIFIER, *key).standard_normal((_BLOCK, n))
        if levels.floor_vibration > 0.0:
            time = self._sample_time * (number * _BLOCK + np.arange(_BLOCK))
            tones = np.cos(time[:, np.newaxis, np.newaxis] * self._rates + self._phases)
            along = levels.floor_vibration * np.sqrt(2.0 / _TONES) * tones.sum(axis=1)
            self.block[FLOOR] = along[:, self._directions]
