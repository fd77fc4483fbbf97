"""
Random draws of the simulated machine, each a pure function of (seed, quantity, cycle, tick of the cycle).

The generators are counter-based: a draw depends on neither the length and number of other cycles nor wall time.
"""

import numpy as np

from pkm_core.plant.arrays import AMPLIFIER, ENCODER, FLOOR

_ASSEMBLY, _CYCLE, _ENCODER, _AMPLIFIER, _FLOOR, _LASER = range(6)  # append new ones, so that existing bits stay
_BLOCK = 1024  # ticks, or laser samples, per draw
_RUN = 32  # ticks that share the coarse part of the floor's phases
_TONES = 24  # of the floor vibration, in each direction


def _generator(seed, *key):
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=key)))


def assembly_generator(seed):
    """Return the generator of the values that are fixed when a machine is built."""
    return _generator(seed, _ASSEMBLY)


class LaserNoise:
    """Standard normal noise of the laser, a pure function of the seed and the number of the sample."""

    def __init__(self, seed, size):
        self._seed = seed
        self._size = size
        self._number = None

    def at(self, samples):
        """Return the noise (K, size) of the samples numbered `samples` (K,), from 0."""
        noise = np.empty((len(samples), self._size))
        for number in np.unique(samples // _BLOCK):
            if number != self._number:
                draw = _generator(self._seed, _LASER, int(number))
                self._number, self._block = number, draw.standard_normal((_BLOCK, self._size))
            rows = samples // _BLOCK == number
            noise[rows] = self._block[samples[rows] % _BLOCK]
        return noise


class CycleNoise:
    """
    The disturbances of one cycle, drawn in blocks of ticks as they are needed.

    Attributes
    ----------
    friction, gain : ndarray, shape (n,)
        Factors on Coulomb friction and thrust in this cycle.

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
        self._rates = 2.0 * np.pi * tones.uniform(*self._band, (_TONES, 2)).T.copy()
        self._phases = tones.uniform(0.0, 2.0 * np.pi, (_TONES, 2)).T.copy()
        self._cycle = cycle
        self._fill(0)

    def at(self, index):
        """
        Return (block, row): the disturbances of tick `index` of the cycle are block[:, row].

        A block has the shape (3, ticks, n), rows arrays.ENCODER [counts], AMPLIFIER [V] and FLOOR [m/s^2], the
        acceleration of the floor along each guide.
        """
        number, row = divmod(index, _BLOCK)
        if number != self._number:
            self._fill(number)
        return self._block, row

    def _fill(self, number):
        levels, shape = self._levels, (_BLOCK, len(self._directions))
        encoder, amplifier = (_generator(self._seed, which, self._cycle, number) for which in (_ENCODER, _AMPLIFIER))
        self._number = number
        self._block = np.zeros((3, *shape))
        self._block[ENCODER] = levels.encoder_noise * encoder.uniform(-1.0, 1.0, shape)
        self._block[AMPLIFIER] = levels.amplifier_noise * amplifier.standard_normal(shape)
        if levels.floor_vibration > 0.0:
            along = levels.floor_vibration * np.sqrt(2.0 / _TONES) * self._tones(number * _BLOCK)
            self._block[FLOOR] = along[:, self._directions]

    def _tones(self, first):
        """Return the sum of the tones (_BLOCK, 2) from tick `first` on, by cos(a + b) = cos a cos b - sin a sin b."""
        ticks = np.arange(_BLOCK).reshape(-1, _RUN, 1, 1)
        a = self._sample_time * (first + ticks[:, 0]) * self._rates + self._phases
        b = self._sample_time * ticks[0] * self._rates
        products = [np.einsum('adt,bdt->abd', part(a), part(b)) for part in (np.cos, np.sin)]
        return (products[0] - products[1]).reshape(_BLOCK, 2)
