"""
Learning a few parameters instead of a signal: parameters learned on some moves are valid for other moves.

    u = B theta,   theta <- theta + gain (G B)^+ e

The columns of B are the forces of regressors.py, filtered by the inverse of lag, notch, delay, drive and modes: at the
slider they act as forces. G B is their effect on the position in the closed loop; ^+ is the least-squares inverse.
Directions that a motion does not excite (a partner at rest, for example) are excluded: singular values below
`resolution` are dropped.

The law needs the reference (`with_reference`) and has two more functions: `parameters` of a feedforward learned on one
motion, and the `feedforward` of another motion from parameters. For parameters that transfer, use a motion in which
partners accelerate in the same and in opposite directions (training.py).

Convergence: (G B)^+ is a projection. In the norm of the position change due to theta, the distance to the fixed point
shrinks at least by the largest |1 - gain G_true/G| within the band, for any motion.
"""

import copy
from typing import Annotated

import numpy as np
from pydantic import Field

from pkm_core.config import Length, Number
from pkm_core.control.margins import unit_circle
from pkm_core.control.systems import plant_system
from pkm_core.errors import LearningError
from pkm_core.learning.law import Law, LawConfig
from pkm_core.learning.regressors import forces
from pkm_core.motion.trajectory import SampledTrajectory

ROUNDING = 1e-6  # of the largest force; below this a column is rounding of a joint at rest


class BasisConfig(LawConfig):
    """Parameters of the law; the forces are limited to `band`."""

    slips: Annotated[
        tuple[Annotated[Length, Field(gt=0)], ...], Field(description='distances over which friction reverses')
    ]
    resolution: Annotated[Number, Field(gt=0, lt=1, description='smallest singular value used, over the largest')]


class BasisLaw(Law):
    """The law with basis functions; it needs a motion, see `with_reference`."""

    Parameters = BasisConfig
    _trajectory: SampledTrajectory | None = None
    _fits: dict

    def with_reference(self, trajectory):
        """Return the law for the motion `trajectory`, in joints."""
        if trajectory.coordinates != self.machine.joints or trajectory.sample_time != self.machine.sample_time:
            raise LearningError(
                f'learning: reference of {trajectory.coordinates} every {trajectory.sample_time} s; '
                f'expected {self.machine.joints} every {self.machine.sample_time} s'
            )
        law = copy.copy(self)
        law._trajectory = trajectory
        law._fits = {joint: law._fit(joint) for joint in law.gains}
        return law

    def parameters(self, joint, feedforward):
        """Return {name: parameter} of a `feedforward` (N,) [V] learned on this law's motion."""
        names, _, recover, _ = self._fitted(joint, len(feedforward))
        return dict(zip(names, (recover @ feedforward).tolist(), strict=True))

    def feedforward(self, joint, parameters, *, rested=False):
        """
        Return the feedforward (N,) [V] of `parameters` on this law's motion.

        `rested`: for the first cycle after power-up, with friction at rest; else for a cycle preceded by the same one.
        """
        names, basis, _, _ = self._fitted(joint, None)
        if set(parameters) != set(names):
            raise LearningError(f'learning {joint}: parameters {sorted(parameters)} given; expected {sorted(names)}')
        if rested:
            basis = self._basis(joint, rested=True)[1]
        return self._bounded(joint, basis @ [parameters[name] for name in names])

    def memory(self, joint, frequency):
        """Return 1 within the band, for the bound on convergence of this module."""
        return (self.band(joint).weight(frequency) > 0).astype(float)

    def action(self, joint, frequency):
        """Return 1/G [V/m] within the band."""
        learned, action = self.band(joint).weight(frequency) > 0, np.zeros(frequency.shape, dtype=complex)
        action[learned] = 1 / self.path(joint, frequency[learned])
        return action

    def _learn(self, joint, error, feedforward, gain):
        _, basis, recover, fit = self._fitted(joint, error.size)
        return basis @ (recover @ feedforward + gain * (fit @ error))

    def _fitted(self, joint, samples):
        expected = len(self._reference(joint))
        if samples not in (None, expected):
            raise LearningError(f'learning {joint}: {samples} samples; the reference has {expected}')
        return self._fits[joint]

    def _reference(self, joint):
        if self._trajectory is None:
            raise LearningError(f'learning {joint}: the basis law needs the reference; none given by with_reference')
        return self._trajectory

    def _fit(self, joint):
        """Return names, B (N, k), B^+ (k, N) and (G B)^+ (k, N)."""
        names, basis = self._basis(joint, rested=False)
        samples = len(basis)
        frequency = np.fft.rfftfreq(samples, self.machine.sample_time)
        path = np.zeros(frequency.shape, dtype=complex)
        path[1:] = self.path(joint, frequency[1:])
        moved = np.fft.irfft(np.fft.rfft(basis, axis=0) * path[:, None], samples, axis=0)
        return names, basis, self._inverse(basis), self._inverse(moved)

    def _inverse(self, columns):
        size = np.linalg.norm(columns, axis=0)
        size[size < ROUNDING * size.max()] = np.inf
        return np.linalg.pinv(columns / size, rcond=self.config.resolution) / size[:, None]

    def _basis(self, joint, *, rested):
        """Return names and B (N, k)."""
        machine, model = self.machine, self.models[joint]
        column = machine.joints.index(joint)
        trajectory = self._reference(joint)
        shapes = forces(machine, model, trajectory, column, self.config.slips, rested=rested)
        samples = len(trajectory)
        frequency = np.fft.rfftfreq(samples, machine.sample_time)
        weight = self.band(joint).weight(frequency)
        learned = weight > 0
        f = frequency[learned]
        z, s, gains = unit_circle(f, machine.sample_time), 2j * np.pi * f, self.gains[joint]
        # from the feedforward to the force: the path to the position without K/(s (s + a))
        arrival = gains.response(z, machine.sample_time) / gains.pid_response(z, machine.sample_time)
        arrival = arrival * plant_system(model, machine.sample_time)(z) * s * (s + model.viscosity) / model.gain
        spectrum = np.fft.rfft(np.stack(list(shapes.values()), axis=1), axis=0)
        spectrum[~learned] = 0
        spectrum[learned] *= (weight[learned] / arrival)[:, None]
        return list(shapes), np.fft.irfft(spectrum, samples, axis=0)
