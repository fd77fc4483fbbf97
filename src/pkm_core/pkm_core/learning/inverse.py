"""
Learning with the inverse of the model of the feedforward's effect on the position.

    U <- Q (U + gain E/G)

G is the response of the model to the learned feedforward, delays included. With a perfect model and gain 1 one cycle is
enough. The inverse is computed on the Fourier series of the whole cycle and is not causal; right-half-plane zeros, as
in P3 of the thesis, and delays are therefore inverted too. Q, the band, excludes the modes, whose frequencies and signs
are too uncertain. The error becomes Q (1 - gain G_true/G) times that of the previous cycle.
"""

import numpy as np

from pkm_core.learning.law import FrequencyLaw, LawConfig


class InverseConfig(LawConfig):
    """Parameters of the law; `band` is Q."""


class InverseLaw(FrequencyLaw):
    """The frequency-domain model inverse with a robustness filter."""

    Parameters = InverseConfig

    def memory(self, joint, frequency):
        """Return Q."""
        return self.band(joint).weight(frequency)

    def action(self, joint, frequency):
        """Return Q/G [V/m]; zero where Q is."""
        weight = self.band(joint).weight(frequency)
        learned, action = weight > 0, np.zeros(frequency.shape, dtype=complex)
        action[learned] = weight[learned] / self.path(joint, frequency[learned])
        return action
