"""
The axis P = K/(s (s + a)) H wc/(s + wc) in partial fractions, for exact step and sampled responses.

The response with zero-order hold, whole samples of computation and any fractional dead time has a closed form. It is a
hundred times faster than state-space matrices; a fit evaluates thousands.
"""

from dataclasses import dataclass

import numpy as np

SLOWEST = 1e-3  # [1/s] least viscosity; at 0 the two integrators would coincide


@dataclass(frozen=True)
class PartialFractions:
    """P(s)/K = slope/s + SUM residues/(s - poles); all poles are different and none is 0."""

    slope: float  # [s]
    poles: np.ndarray  # (p,) complex [1/s]
    residues: np.ndarray  # (p,) complex

    @classmethod
    def of(cls, viscosity, corner, modes):
        """
        Return the fractions of P/K.

        Parameters
        ----------
        viscosity : float
            a [1/s]; raised to SLOWEST if lower.
        corner : float
            Corner of the current loop [Hz]; infinite leaves the current loop out.
        modes : ndarray, shape (m, 4)
            Rows (resonance [Hz], its damping, anti-resonance [Hz], its damping) of H.

        """
        resonance, damping, antiresonance, zero_damping = np.asarray(modes, dtype=np.float64).reshape(-1, 4).T
        poles = np.concatenate([[-max(viscosity, SLOWEST)], _pairs(resonance, damping)])
        zeros = _pairs(antiresonance, zero_damping)
        gain = np.prod((resonance / antiresonance) ** 2)
        if np.isfinite(corner):
            poles, gain = np.append(poles, -2 * np.pi * corner), gain * 2 * np.pi * corner
        others = poles[:, np.newaxis] - poles + np.eye(poles.size)
        residues = gain * np.prod(poles[:, np.newaxis] - zeros, axis=1) / (poles * np.prod(others, axis=1))
        return cls(float((gain * np.prod(-zeros) / np.prod(-poles)).real), poles, residues)

    def at(self, s):
        """Return P/K at the complex points `s` (F,)."""
        return self.slope / s + (1 / (s[:, np.newaxis] - self.poles)) @ self.residues

    def step(self, time):
        """Return the response (N,) at `time` (N,) [s] to a unit step at time 0."""
        late = np.maximum(time, 0.0)
        return self.slope * late + (np.expm1(np.outer(late, self.poles)) @ (self.residues / self.poles)).real

    def sampled(self, z, sample_time, delay=0.0):
        """Return the response (F,) at the points `z` (F,) with hold and a dead time `delay` [s] of under a sample."""
        z = np.asarray(z)[:, np.newaxis]
        whole, rest = np.exp(self.poles * sample_time), np.exp(self.poles * (sample_time - delay))
        held = (rest - 1 + (whole - rest) / z) / (z - whole)
        integrated = (sample_time - delay + delay / z[:, 0]) / (z[:, 0] - 1)
        return held @ (self.residues / self.poles) + self.slope * integrated


def _pairs(frequency, damping):
    """Return the roots of the factors s^2 + 2 z w s + w^2, w = 2 pi `frequency`; complex, two per factor."""
    w = 2 * np.pi * np.asarray(frequency)
    root = w * np.emath.sqrt(np.square(damping) - 1)
    return np.concatenate([-damping * w + root, -damping * w - root]).astype(np.complex128)


def mode_rows(modes):
    """Return the modes of an `AxisModel` as the argument `modes` (m, 4) of `PartialFractions.of`."""
    rows = [(mode.resonance, mode.resonance_damping, mode.antiresonance, mode.antiresonance_damping) for mode in modes]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)
