"""
The two filters behind the PID, in physical units, and their discrete form.

A discrete filter is given by the coefficients [b0, b1, b2, a1, a2] of (b0 + b1/z + b2/z^2)/(1 + a1/z + a2/z^2).
"""

from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field

from pkm_core.config import Config, Frequency, Number
from pkm_core.errors import ConfigError
from pkm_core.quantities import split


def _decibel(value, info):
    """Return the number of a text such as '4.1 dB', which pint cannot parse; from Python a float is accepted too."""
    if isinstance(value, float) and not info.context:
        return value
    number, unit = split(value) if isinstance(value, str) else (value, '')
    if unit != 'dB':
        raise ValueError(f"{value!r} is not an attenuation; expected e.g. '15.0 dB'")
    return number


Decibel = Annotated[float, BeforeValidator(_decibel)]


class Lag(Config):
    """
    Lag filter FL(z) = KL (z - zc)/(z - pc), pc = exp(-2 pi pole Ts), zc = exp(-2 pi zero Ts) (7.22).

    The thesis prints (7.22) in s without Ts; its pole and zero are values in the z plane.
    """

    pole: Annotated[Frequency, Field(gt=0, description='F1')]
    zero: Annotated[Frequency, Field(gt=0, description='F2, above F1')]
    dc_gain: Annotated[Number, Field(gt=0, description='KL (1 - zc)/(1 - pc)')]

    def discrete(self, sample_time):
        """Return the five coefficients at `sample_time` [s]."""
        pole, zero = np.exp(-2 * np.pi * np.array([self.pole, self.zero]) * sample_time)
        gain = self.dc_gain * (1 - pole) / (1 - zero)
        return np.array([gain, -gain * zero, 0.0, -pole, 0.0])


class Notch(Config):
    """Notch FN(s) = (s^2 + A wb s + wr^2)/(s^2 + wb s + wr^2), wb = wh - wl, wr^2 = wh wl, A = 10^(-att/20) (7.23)."""

    centre: Annotated[Frequency, Field(gt=0, description='wr')]
    width: Annotated[Frequency, Field(gt=0, description='wb')]
    attenuation: Annotated[Decibel, Field(gt=0, description='[dB] at the centre, exactly')]

    def magnitude(self, frequency):
        """Return |FN| at `frequency` [Hz], any shape."""
        w2, wr2, wb = np.square(frequency), self.centre**2, self.width * np.asarray(frequency)
        return np.abs((wr2 - w2 + 1j * wb * self._depth()) / (wr2 - w2 + 1j * wb))

    def discrete(self, sample_time):
        """Return the five coefficients at `sample_time` [s]: bilinear, pre-warped to keep the centre frequency."""
        if self.centre * sample_time >= 0.5:
            raise ConfigError(f'notch: centre is {self.centre:g} Hz; allowed below {0.5 / sample_time:g} Hz')
        # with s = wr/t (z - 1)/(z + 1) the result depends only on t and the width relative to the centre
        t = np.tan(np.pi * self.centre * sample_time)
        pole = self.width / self.centre * t
        zero = self._depth() * pole
        square = t * t
        middle = 2 * (square - 1)
        return np.array([1 + zero + square, middle, 1 - zero + square, middle, 1 - pole + square]) / (1 + pole + square)

    def _depth(self):
        return 10 ** (-self.attenuation / 20)


def low_frequency_delay(coefficients, sample_time):
    """Return the group delay [s] of a discrete filter at zero frequency."""
    b0, b1, b2, a1, a2 = coefficients
    return float(sample_time * ((b1 + 2 * b2) / (b0 + b1 + b2) - (a1 + 2 * a2) / (1 + a1 + a2)))
