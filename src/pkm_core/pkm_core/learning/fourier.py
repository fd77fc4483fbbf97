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
The error of a cycle becomes lam - Gl HL HN z^advance PID FL FN P/(1 + L) times that of the cycle before.
"""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from pkm_core.config import Config, Frequency, Number, Time
from pkm_core.learning.request import check_request


class Band(Config):
    """Zero-phase weight HL: half a cosine up from `rise_from` to `rise_to`, down from `fall_from` to `fall_to`."""

    rise_from: Annotated[Frequency, Field(ge=0)]
    rise_to: Frequency
    fall_from: Frequency
    fall_to: Frequency

    @model_validator(mode='after')
    def _is_in_order(self):
        if not self.rise_from < self.rise_to < self.fall_from < self.fall_to:
            raise ValueError('expected rise_from < rise_to < fall_from < fall_to')
        return self

    def weight(self, frequency):
        """Return the weight at `frequency` [Hz]."""
        rise = np.clip((frequency - self.rise_from) / (self.rise_to - self.rise_from), 0, 1)
        fall = np.clip((frequency - self.fall_from) / (self.fall_to - self.fall_from), 0, 1)
        return 0.25 * (1 - np.cos(np.pi * rise)) * (1 + np.cos(np.pi * fall))


class FourierConfig(Config):
    """Parameters of the law, the same for all joints."""

    # Gl of update 0, 1, ...; the last one stays
    gain: Annotated[tuple[Annotated[Number, Field(gt=0, le=1)], ...], Field(min_length=1)]
    forgetting: Annotated[Number, Field(gt=0, le=1)]  # lam
    advance: Annotated[Time, Field(ge=0)]
    integral: Annotated[Number, Field(ge=0, le=1)]  # share of KI
    derivative: Annotated[Number, Field(ge=0, le=1)]  # share of KD
    band: Band


class FourierLaw:
    """
    Learning law of all joints of a machine.

    Parameters
    ----------
    config : FourierConfig
    control : dict of str to RobustGains
        The loops it learns for.
    sample_time : float
        [s]

    """

    def __init__(self, config, control, sample_time):
        self.config = config
        self._control = control
        self._sample_time = sample_time
        self._minimum = int(np.ceil(1 / (config.band.fall_from * sample_time)))  # one period of the highest full weight

    def update(self, joint, error, feedforward, iteration, sample_time):
        """
        Return the feedforward [V] of the next cycle, shape (N,).

        Raises
        ------
        LearningError
            If the joint is unknown, lengths differ or are too short, a value is not finite, or the sample time differs.

        """
        error, feedforward = np.asarray(error, dtype=np.float64), np.asarray(feedforward, dtype=np.float64)
        check_request(
            joint, self._control, error, feedforward, iteration, sample_time,
            expected_time=self._sample_time, minimum=self._minimum,
        )  # fmt: skip
        gain = self.config.gain[min(iteration, len(self.config.gain) - 1)]
        frequency = np.fft.rfftfreq(error.size, sample_time)
        correction = np.fft.irfft(self.action(joint, frequency) * np.fft.rfft(error), error.size)
        return self.config.forgetting * feedforward + gain * correction

    def action(self, joint, frequency):
        """Return HL HN z^advance PID [V/m] at `frequency` [Hz]; zero where HL is, so also at 0 Hz."""
        gains, config = self._control[joint], self.config
        weight = config.band.weight(frequency)
        learned = weight > 0
        f, action = frequency[learned], np.zeros(frequency.shape, dtype=complex)
        z = np.exp(2j * np.pi * f * self._sample_time)
        action[learned] = (
            weight[learned]
            * gains.notch.magnitude(f)
            * np.exp(2j * np.pi * f * config.advance)
            * gains.pid_response(z, self._sample_time, integral=config.integral, derivative=config.derivative)
        )
        return action
