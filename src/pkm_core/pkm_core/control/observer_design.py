"""
Design of the observer law of one axis: Kalman filter and LQR on its sampled model, with a disturbance state.

    x+ = A x + B (u + d + w),  d+ = d + v,  y = C x + n

A, B, C are z^-1 ZOH{P} of systems.py: current loop, load, all modes, and the computation delay. x is that of the
deviation from the reference, in um. The Kalman filter has the variances of w (force noise), v (drift of the
disturbance), n (encoder) and of a noise on the states of the modes. The feedback is -K x - d, with K from

    sum of y^2 + (speed ydot)^2 + (effort u)^2 -> min

d makes the law integrate. `mode_damping` multiplies the dampings of the modes in the design alone: a broad mode is less
sensitive to its frequency.
"""

from functools import lru_cache
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from pkm_core.config import Config, Length, Number, Time, Voltage, quantity
from pkm_core.control.model import AxisModel
from pkm_core.control.pid import AxisLaw
from pkm_core.control.systems import System, plant_system
from pkm_core.control.uncertainty import IDENTIFIED
from pkm_core.errors import PkmError

_DIGITS = 12  # of the designed gains: LAPACK of another processor differs from the 13th on
_UM = 1e6


class ObserverWeights(Config):
    """Weights and noises of the observer law of one axis; deviations of the noises are those of one sample."""

    effort: Annotated[quantity('m/V'), Field(gt=0, description='error that counts as much as 1 V of feedback')]
    speed: Annotated[Time, Field(ge=0, description='weight of the speed of the error')]
    force_noise: Annotated[Voltage, Field(gt=0, description='deviation of the force, as drive voltage')]
    drift: Annotated[Voltage, Field(gt=0, description='deviation of the step of the disturbance')]
    encoder_noise: Annotated[Length, Field(gt=0, description='deviation of the reading')]
    mode_noise: Annotated[Length, Field(ge=0, description='deviation of the states of the modes')]
    mode_damping: Annotated[Number, Field(ge=1, le=20, description='factor of the dampings in the design')]


class ObserverLaw(AxisLaw, Config):
    """The observer law of one axis: its `weights` on the `AxisModel` `model`."""

    weights: ObserverWeights
    model: AxisModel

    uncertainty: ClassVar = IDENTIFIED

    def on(self, model):
        """Return the law with the same weights, designed on another `AxisModel`."""
        return self.model_copy(update={'model': model})

    def design(self, sample_time):
        """Return (A, B, K, M) of `designed`."""
        return designed(self.weights, self.model, sample_time)

    def system(self, sample_time):
        """Return the law, error [m] to voltage [V], as a discrete `System`."""
        return _law_system(self.weights, self.model, sample_time)

    def response(self, z, sample_time):
        """Return the law [V/m] at the points `z` of the unit circle, z = 1 excluded."""
        return self.system(sample_time)(z)

    pid_response = response  # a feedforward is added behind the whole law


@lru_cache(maxsize=64)
def designed(weights, model, sample_time):
    """
    Return A (n, n), B (n,), K (n,), M (n + 1,) of this module in um and V; y is the last state.

    Raises
    ------
    PkmError
        If the Riccati equations of these weights have no solution.

    """
    from scipy.linalg import solve_discrete_are

    plant = plant_system(_widened(model, weights.mode_damping), sample_time)
    A, B, C = plant.A, plant.B, plant.C
    n, speed = B.size, (C @ A - C) / sample_time
    wide = np.block([[A, B], [np.zeros((1, n)), np.ones((1, 1))]])
    seen = np.hstack([C, [[0.0]]])
    entering = np.vstack([B, [[0.0]]])
    noise = weights.force_noise**2 * entering @ entering.T
    noise[n, n] = weights.drift**2
    modes = range(3, n - 1)
    noise[modes, modes] += (_UM * weights.mode_noise) ** 2
    effort, reading = np.array([[(_UM * weights.effort) ** 2]]), np.array([[(_UM * weights.encoder_noise) ** 2]])
    try:
        P = solve_discrete_are(A, B, C.T @ C + weights.speed**2 * speed.T @ speed, effort)
        S = solve_discrete_are(wide.T, seen.T, noise, reading)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise PkmError(f'observer: no design for {weights!r}: {error}') from None
    K = np.linalg.solve(effort + B.T @ P @ B, B.T @ P @ A)[0]
    M = (S @ seen.T / (seen @ S @ seen.T + reading))[:, 0]
    return _rounded(A), _rounded(B[:, 0]), _rounded(K), _rounded(M)


@lru_cache(maxsize=64)
def _law_system(weights, model, sample_time):
    A, B, K, M = designed(weights, model, sample_time)
    n = B.size
    correction = np.eye(n + 1)
    correction[:, n - 1] -= M  # state after the measurement: correction x + M y
    control, after = np.append(K, 1.0), np.zeros((n + 1, n + 1))
    after[:n, :n], after[n, n] = A - np.outer(B, K), 1.0
    return System.of(after @ correction, -_UM * (after @ M), -control @ correction, _UM * control @ M)


def _widened(model, factor):
    """Return `model` in um, the dampings of its modes multiplied by `factor` up to 0.7."""

    def damped(value):
        return float(np.clip(factor * value, -0.7, 0.7))

    modes = tuple(
        mode.model_copy(
            update={name: damped(getattr(mode, name)) for name in ('resonance_damping', 'antiresonance_damping')}
        )
        for mode in model.modes
    )
    return model.model_copy(update={'gain': _UM * model.gain, 'modes': modes})


def _rounded(values):
    """Return `values` with `_DIGITS` significant digits."""
    sizes = np.abs(values)
    scale = 10.0 ** (_DIGITS - 1 - np.floor(np.log10(np.where(sizes > 0, sizes, 1.0))))
    return np.round(values * scale) / scale
