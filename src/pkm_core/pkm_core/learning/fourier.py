"""
The thesis's learning law (7.31)-(7.33), in one step over the Fourier series of a cycle.

    eps = HL HN e                                     zero phase (7.31)
    psi <- Gl eps + lam psi                           (7.32)
    ups(k) = [KP + I + D] psi(k + advance)            (7.33)

PID is linear and the cycle periodic; the memory psi need not be stored: ups <- lam ups + Gl PID eps(k + advance).
The series of the thesis sums n = 1..N-1 with a factor of 2 and yields 2 e - R0; the FFT is the intended series.

(7.33) has PD action with gains that the thesis does not print. Here `integral` and `derivative` are shares of the
loop's KI and KD. With the whole PID (1, 1) ups acts as a correction of the reference: this needs no plant model and
converges fast. PD (0, small) is the law of the thesis. With the whole KD of the loop it diverges below 20 Hz if the
loop has strong integral action: the response of the loop to ups leads by up to 90 deg, and D adds to that.

As printed, (7.33) has no advance. The delay of the loop then shifts the learned signal by more than 90 deg above a
frequency of 29 to 56 Hz here, and above it the error grows slowly. The advance compensates the delay in whole samples.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from pkm_core.config import Number
from pkm_core.control.margins import unit_circle
from pkm_core.control.pid import PidLaw
from pkm_core.errors import LearningError
from pkm_core.learning.law import FrequencyLaw, LawConfig


class FourierConfig(LawConfig):
    """Parameters of the law; `gain` is Gl and `band` is HL."""

    forgetting: Annotated[Number, Field(gt=0, le=1, description='lam')]
    integral: Annotated[Number, Field(ge=0, le=1, description='share of KI')]
    derivative: Annotated[Number, Field(ge=0, le=1, description='share of KD')]


class FourierLaw(FrequencyLaw):
    """
    The law of (7.31)-(7.33).

    Attributes
    ----------
    advance : dict of str to int
        Advance of the learned signal of each joint [samples]: the delay of its loop model at the frequency at which HL
        has fallen to one half; above it the law learns little.

    """

    Parameters = FourierConfig

    def __init__(self, config, machine, gains):
        super().__init__(config, machine, gains)
        for joint, axis in gains.items():
            if not isinstance(axis, PidLaw):
                raise LearningError(
                    f'learning: {joint} has {type(axis).__name__}; the law fourier needs a PID; allowed: inverse, '
                    'norm_optimal, basis'
                )
        self.advance = {joint: self._loop_delay(joint) for joint in gains}

    def as_printed(self):
        """Return the law without its advance, as (7.33) is printed; it diverges and serves for comparison only."""
        law = FourierLaw(self.config, self.machine, self.gains)
        law.advance = dict.fromkeys(self.advance, 0)
        return law

    def memory(self, joint, frequency):
        """Return lam."""
        return np.full(frequency.shape, self.config.forgetting)

    def action(self, joint, frequency):
        """Return HL HN z^advance PID [V/m]; zero where HL is zero."""
        weight = self.band(joint).weight(frequency)
        learned, action = weight > 0, np.zeros(frequency.shape, dtype=complex)
        f = frequency[learned]
        z = unit_circle(f, self.machine.sample_time)
        notch = self.gains[joint].notch.magnitude(f)
        action[learned] = weight[learned] * notch * z ** self.advance[joint] * self._pid(joint, z)
        return action

    def _pid(self, joint, z):
        config = self.config
        return self.gains[joint].pid_response(
            z, self.machine.sample_time, integral=config.integral, derivative=config.derivative
        )

    def _loop_delay(self, joint):
        """Return the phase delay [samples] of PID G at half weight, unwrapped from low frequencies."""
        sample_time, band = self.machine.sample_time, self.band(joint)
        frequency = np.linspace(0, (band.fall_from + band.fall_to) / 2, 200)[1:]
        answer = self._pid(joint, unit_circle(frequency, sample_time)) * self.path(joint, frequency)
        turns = -np.unwrap(np.angle(answer))[-1] / (2 * np.pi)
        return max(0, round(turns / (frequency[-1] * sample_time)))
