"""
Learning with the inverse of the model: the error of a cycle, taken back through the path of the feedforward.

    U <- Q (U + gain E/G)

G is the model's answer to the learned feedforward, delays and all, so with a perfect model and gain 1 one cycle is
enough. It is inverted over the Fourier series of the whole cycle, without regard to causality: right-half-plane zeros,
as the thesis's P3 has them, and delays do no harm. Q, the band, keeps the law away from the modes, whose frequencies
and signs nobody knows well enough. The error becomes Q (1 - gain G_true/G) times that of the cycle before.
"""

import numpy as np

from pkm_core.learning.law import FrequencyLaw, LawConfig


class InverseConfig(LawConfig):
    """Parameters of the law; `band` is Q."""


class InverseLaw(FrequencyLaw):
    """The frequency-domain model inverse with robustness filter."""

    Parameters = InverseConfig

    def memory(self, joint, frequency):
        """Return Q."""
        return self.config.band.weight(frequency)

    def action(self, joint, frequency):
        """Return Q/G [V/m]; zero where Q is."""
        weight = self.config.band.weight(frequency)
        learned, action = weight > 0, np.zeros(frequency.shape, dtype=complex)
        action[learned] = weight[learned] / self.path(joint, frequency[learned])
        return action
