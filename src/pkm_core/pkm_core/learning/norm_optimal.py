"""
Norm-optimal learning: the next feedforward v minimises

    |e - G (v - u)|^2 + |v|^2 weighted with S + |v - u|^2 weighted with R

over a whole cycle in lifted form: error, effort and change. Cycles follow each other without a reset; in steady
repetition the lifted G is circulant, and the Fourier series of the cycle diagonalises the problem:

    V = ((|G|^2 + R) U + gain G* E)/(|G|^2 + S + R)

S weights second differences, |1 - 1/z|^4. It equals |G|^2 at the frequency `effort`, above which the law learns little.
R is constant and small compared with the largest |G|^2. It limits the law where G is small: without R the slow
harmonics, G -> 0 with integral action, are 0/0 and the learned signal drifts to millimetres.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from pkm_core.config import Frequency, Number
from pkm_core.learning.law import FrequencyLaw, LawConfig


class NormOptimalConfig(LawConfig):
    """Parameters of the law; the feedforward is zero outside `band`."""

    effort: Annotated[Frequency, Field(gt=0, description='where S = |G|^2')]
    change: Annotated[Number, Field(gt=0, description='R over the largest |G|^2')]


class NormOptimalLaw(FrequencyLaw):
    """The norm-optimal law in lifted form."""

    Parameters = NormOptimalConfig

    def __init__(self, config, machine, gains):
        super().__init__(config, machine, gains)
        self._change, self._effort = {}, {}
        for joint in gains:
            frequency = np.arange(1.0, self.band(joint).fall_to)
            self._change[joint] = config.change * np.abs(self.path(joint, frequency)).max() ** 2
            corner = np.array([config.effort])
            self._effort[joint] = float(np.abs(self.path(joint, corner))[0] ** 2 / self._second_difference(corner)[0])

    def memory(self, joint, frequency):
        """Return (|G|^2 + R)/(|G|^2 + S + R) within the band."""
        return self._solution(joint, frequency)[0]

    def action(self, joint, frequency):
        """Return G*/(|G|^2 + S + R) [V/m] within the band."""
        return self._solution(joint, frequency)[1]

    def _solution(self, joint, frequency):
        weight = self.band(joint).weight(frequency)
        learned = weight > 0
        memory, action = np.zeros(frequency.shape), np.zeros(frequency.shape, dtype=complex)
        f, change = frequency[learned], self._change[joint]
        path = self.path(joint, f)
        square = np.abs(path) ** 2
        whole = square + self._effort[joint] * self._second_difference(f) + change
        memory[learned] = weight[learned] * (square + change) / whole
        action[learned] = weight[learned] * path.conj() / whole
        return memory, action

    def _second_difference(self, frequency):
        return (2 * np.sin(np.pi * frequency * self.machine.sample_time)) ** 4
