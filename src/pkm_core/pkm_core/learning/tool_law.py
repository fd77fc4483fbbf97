"""
Learning of the reference at the tool: what the laser sees and the encoders do not.

    dr <- dr + gain LP(J^-1 e_laser - e_encoder)

dr [m] is added to the reference of the joints, e_laser is the error of the tool, J the Jacobian of the machine in use,
e_encoder = r + dr - y the error that the controllers reduce. With y the readings and d the deviation of the tool from
them in slider lengths (links, marks, encoder delay, belts, platform), J^-1 e_laser - e_encoder is d - dr: dr converges
to d, whatever the controllers do. The learning of the joints continues beside it and reduces e_encoder.

The correction acts on the reference, because the integrator opposes any static correction of the voltage. Its
derivatives are those of its Fourier series, and the feedforward of the controllers includes them. LP is a zero-phase
low-pass. Its rest at home is zero: the datum of the laser is not the home of the encoders.
"""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from pkm_core.config import Config, Frequency, Number, Time, find_config, load_config
from pkm_core.errors import LearningError
from pkm_core.learning.laser_record import at_home, at_ticks, check_record, cycle_times, error_samples
from pkm_core.motion.trajectory import SampledTrajectory


class ToolLawConfig(Config):
    """Parameters of learning at the tool."""

    gain: Annotated[
        tuple[Annotated[Number, Field(gt=0, le=0.3)], ...],
        Field(min_length=1, description='of update 0, 1, ...; the last one is kept'),
    ]
    flat_to: Annotated[Frequency, Field(gt=0, description='end of the pass band')]
    zero_at: Annotated[Frequency, Field(gt=0, description='from here on nothing is learned')]
    lowest_mode: Annotated[Frequency, Field(gt=0, description='of the elasticity between joints and tool')]
    mode_damping: Annotated[Number, Field(gt=0, lt=1, description='of that mode')]
    jacobian_error: Annotated[Number, Field(ge=0, lt=1, description='of the machine in use')]
    largest_gap: Annotated[Time, Field(gt=0, description='between samples of the laser')]

    @model_validator(mode='after')
    def _band_is_in_order(self):
        if not self.flat_to < self.zero_at:
            raise ValueError(f'expected flat_to < zero_at; given {self.flat_to:g} and {self.zero_at:g} Hz')
        return self

    def weight(self, frequency):
        """Return LP at `frequency` [Hz]: 1 up to `flat_to`, a half cosine down to 0 at `zero_at`."""
        fall = np.clip((frequency - self.flat_to) / (self.zero_at - self.flat_to), 0, 1)
        return 0.5 * (1 + np.cos(np.pi * fall))


def load_tool_law(machine, name_or_path='laser') -> ToolLawConfig:
    """Return the `ToolLawConfig` of config/learning/tool/NAME.yaml or of a path; `ConfigError` if it is refused."""
    return load_config(find_config('learning/tool', name_or_path, machine.configuration), ToolLawConfig)


class ToolLaw:
    """
    The law for one motion, without state.

    Parameters
    ----------
    config : ToolLawConfig
    machine : Machine
        Its Jacobian is that of the law: the calibrated machine, if there is one.
    poses, joints : SampledTrajectory
        The motion as planned, in poses and in joints; N samples.
    verdict : str
        Result of its convergence test; '' before the test.

    Raises
    ------
    LearningError
        If the laser is too slow for the band, or the machine has no Jacobian that can be inverted on the motion.

    """

    def __init__(self, config, machine, poses, joints, verdict=''):
        fastest = 0.5 / machine.laser_sample_time
        if config.zero_at >= fastest:
            raise LearningError(
                f'learning at the tool: zero_at {config.zero_at:g} Hz; allowed below {fastest:g} Hz, half the rate of '
                f'the laser'
            )
        self.config, self.machine, self.poses, self.joints = config, machine, poses, joints
        self.verdict = verdict
        J = machine.jacobian(joints.position)
        if J.shape[-1] != J.shape[-2]:
            raise LearningError(
                f'learning at the tool: {machine.name} has a Jacobian {J.shape[-2:]}; expected a square'
            )
        self._inverse = np.linalg.inv(J)  # (N, n, m)
        samples = len(joints)
        self._frequency = np.fft.rfftfreq(samples, joints.sample_time)
        self._weight = config.weight(self._frequency)[:, np.newaxis]
        self._home = at_home(joints, np.arange(samples) * joints.sample_time)

    def tool_error(self, first_tick, time, displacement):
        """
        Return the error of the tool (N, n) [m] at the ticks of a cycle, in slider lengths: J^-1 e_laser.

        Parameters
        ----------
        first_tick : int
            Tick of sample 0 of the cycle.
        time : array_like, shape (K,)
            Of the laser samples, since tick 0 [s].
        displacement : array_like, shape (K, m)
            [m, rad]

        Raises
        ------
        LearningError
            If the record has no samples, gaps, times that do not rise, or a value that is not finite.

        """
        samples, duration = len(self.poses), len(self.poses) * self.poses.sample_time
        displacement = np.asarray(displacement, dtype=np.float64)
        time = np.asarray(time, dtype=np.float64)
        if not np.isfinite(time).all():
            raise LearningError(f'laser: a time is {time[~np.isfinite(time)][0]}; expected a finite number')
        time = cycle_times(self.machine, time, first_tick)
        check_record(time, displacement, duration, self.machine.coordinates, self.config.largest_gap)
        error = error_samples(self.poses, time, self.machine.from_laser(displacement))
        seen = at_ticks(time, error, samples, self.poses.sample_time, self.config.zero_at)
        return np.einsum('kij,kj->ki', self._inverse, seen)

    def update(self, correction, tool_error, error, iteration):
        """
        Return the correction dr (N, n) [m] of the next cycle.

        Parameters
        ----------
        correction : ndarray, shape (N, n)
            That of the cycle [m].
        tool_error : ndarray, shape (N, n)
            Of `tool_error` [m].
        error : ndarray, shape (N, n)
            By the encoders, corrected reference minus measurement [m].
        iteration : int
            Number of updates so far.

        """
        gain = self.config.gain[min(iteration, len(self.config.gain) - 1)]
        change = np.fft.irfft(self._weight * np.fft.rfft(tool_error - error, axis=0), len(error), axis=0)
        return correction + gain * (change - change[self._home].mean(axis=0))

    def motion_of(self, correction):
        """Return `correction` (N, n) [m] with the derivatives of its Fourier series, as a `SampledTrajectory`."""
        spectrum, slope = np.fft.rfft(correction, axis=0), (2j * np.pi * self._frequency)[:, np.newaxis]
        rows = [np.fft.irfft(spectrum * slope**order, len(correction), axis=0) for order in (1, 2, 3)]
        moves = self.joints.move_starts, self.joints.move_ends
        return SampledTrajectory(self.joints.sample_time, self.joints.coordinates, correction, *rows, *moves)
