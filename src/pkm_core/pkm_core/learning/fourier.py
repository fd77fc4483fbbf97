"""
The thesis's learning law (7.31)-(7.33), in one step over the Fourier series of a cycle.

    eps = HL HN e                                     zero phase (7.31)
    psi <- Gl eps + lam psi                           (7.32)
    ups(k) = [KP + I + D] psi(k + advance)            (7.33)

PID is linear and the cycle periodic, so the memory psi need not be kept: ups <- lam ups + Gl PID eps(k + advance).
The thesis's series sums n = 1..N-1 with factor 2 and so returns 2 e - R0; the FFT is the series it means.

(7.33) has PD action with gains the thesis does not print. Here `integral` and `derivative` give the action as shares of
the loop's KI and KD. The whole PID (1, 1) makes ups act like a correction of the reference: it needs no plant model and
converges fast. PD (0, small) is the thesis's. With the loop's whole KD it diverges below 20 Hz if the loop integrates
strongly: the loop's answer to ups then leads by up to 90 deg, and D adds to that.

As printed, (7.33) has no advance. Then the loop's delay turns what is learned by more than 90 deg from some frequency
on, 29 to 56 Hz here, and from there on the error grows slowly. The advance takes that delay back, in whole samples.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from pkm_core.config import Number
from pkm_core.control.margins import unit_circle
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
        By how many samples each joint's learned signal is ahead: the delay with which the model of its loop answers it
        where HL has fallen to one half, beyond which nothing much is learned.

    """

    Parameters = FourierConfig

    def __init__(self, config, machine, control):
        super().__init__(config, machine, control)
        self.advance = {joint: self._loop_delay(joint) for joint in control}

    def as_printed(self):
        """Return the law without its advance, as (7.33) is printed; it diverges, and is only there to be looked at."""
        law = FourierLaw(self.config, self.machine, self.control)
        law.advance = dict.fromkeys(self.advance, 0)
        return law

    def memory(self, joint, frequency):
        """Return lam."""
        return np.full(frequency.shape, self.config.forgetting)

    def action(self, joint, frequency):
        """Return HL HN z^advance PID [V/m]; zero where HL is."""
        weight = self.config.band.weight(frequency)
        learned, action = weight > 0, np.zeros(frequency.shape, dtype=complex)
        f = frequency[learned]
        z = unit_circle(f, self.machine.sample_time)
        notch = self.control[joint].notch.magnitude(f)
        action[learned] = weight[learned] * notch * z ** self.advance[joint] * self._pid(joint, z)
        return action

    def _pid(self, joint, z):
        config = self.config
        return self.control[joint].pid_response(
            z, self.machine.sample_time, integral=config.integral, derivative=config.derivative
        )

    def _loop_delay(self, joint):
        """Return the phase delay [samples] of PID G at half weight, followed up from low frequencies."""
        sample_time, band = self.machine.sample_time, self.config.band
        frequency = np.linspace(0, (band.fall_from + band.fall_to) / 2, 200)[1:]
        answer = self._pid(joint, unit_circle(frequency, sample_time)) * self.path(joint, frequency)
        turns = -np.unwrap(np.angle(answer))[-1] / (2 * np.pi)
        return max(0, round(turns / (frequency[-1] * sample_time)))
