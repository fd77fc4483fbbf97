"""The swept sine in the closed loop: its generation, and a forecast of its effect from the present model."""

from dataclasses import dataclass

import numpy as np

from pkm_core.identification import IdentificationError
from pkm_core.identification.partial_fractions import PartialFractions, mode_rows

_SLIDING = 0.9  # largest speed of the vibration over that of the jog; below 1 the slider never stops
_FEWEST_LINES = 10


@dataclass(frozen=True)
class Sweep:
    """Settings of the swept sine."""

    band: tuple[float, float] = (80.0, 500.0)  # [Hz], thesis 7.3.2
    period: float = 0.512  # [s]; lines every 2 Hz, the sharpest resonance of the thesis is 9 Hz wide
    periods: int = 3  # in each direction of the jog
    settling: float = 0.128  # [s] before the evaluated periods of a pass; transients of the slowest loop decay by 99 %
    speed: float = 15e-3  # [m/s] of the jog; puts the error of a 20 um signal period at 750 Hz, above the band
    shake: float = 0.6  # largest speed of the vibration over that of the jog
    voltage: float = 2.5  # [V] largest amplitude; at most half the limit of the drive


def one_period(sweep, model, gains, sample_time, limit):
    """
    Return one period (P,) [V]: the frequency rises linearly; speed of vibration and voltage limit the amplitude.

    Parameters
    ----------
    sweep : Sweep
        Settings.
    model : AxisModel
        Present model of the axis.
    gains : RobustGains
        Gains of the axis during the sweep.
    sample_time : float
        Sample time [s].
    limit : float
        Limit of the drive [V].

    Raises
    ------
    IdentificationError
        If the band exceeds half the sampling rate or has too few lines.

    """
    _check(sweep, sample_time)
    count = round(sweep.period / sample_time)
    duration = count * sample_time
    low, high = (round(edge * duration) for edge in sweep.band)  # [turns per period of the sweep]
    high += (low + high) % 2  # makes the phase of a period a whole number of turns
    s = np.arange(count) / count
    frequency = (low + (high - low) * s) / duration
    rigid = model.gain / (2 * np.pi * frequency) * np.abs(_sensitivity(model, gains, frequency, sample_time))
    amplitude = np.minimum(min(sweep.voltage, 0.5 * limit), sweep.shake * sweep.speed / rigid)
    volts = amplitude * np.sin(2 * np.pi * (low * s + 0.5 * (high - low) * s * s))
    fastest = np.abs(forecast(model, gains, volts, sample_time)[1]).max()
    return volts * min(1.0, _SLIDING * sweep.speed / fastest)  # fast changes overshoot the steady amplitude


def forecast(model, gains, volts, sample_time):
    """Return drive voltage (N,) [V] and carriage speed (N,) [m/s] in closed loop for the excitation `volts` (N,)."""
    frequency = np.fft.rfftfreq(len(volts), sample_time)[1:]
    spectrum = np.fft.rfft(volts)[1:] * _sensitivity(model, gains, frequency, sample_time)
    # friction acts on the carriage, hence the rigid part without H
    speed = spectrum * model.gain / (2j * np.pi * frequency + model.viscosity)
    return tuple(np.fft.irfft(np.append(0, each), len(volts)) for each in (spectrum, speed))


def _check(sweep, sample_time):
    (low, high), nyquist = sweep.band, 0.5 / sample_time
    what = f'sweep from {low:g} to {high:g} Hz'
    if not 0 < low < high < nyquist:
        raise IdentificationError(f'{what}; expected 0 < from < to < {nyquist:g} Hz, half the sampling rate')
    lines = (high - low) * sweep.period
    if lines < _FEWEST_LINES:
        raise IdentificationError(
            f'{what} in {1e3 * sweep.period:g} ms has {lines:.1f} lines; at least {_FEWEST_LINES} are needed'
        )
    if sweep.periods < 2:
        raise IdentificationError(
            f'{what}: {sweep.periods} period per pass; at least 2 are needed to separate drift and sweep'
        )


def _sensitivity(model, gains, frequency, sample_time):
    """Return S = 1/(1 + L) of the loop at `frequency` (F,) [Hz], all above 0."""
    z = np.exp(2j * np.pi * frequency * sample_time)
    fractions = PartialFractions.of(model.viscosity, model.current_loop, mode_rows(model.modes))
    plant = model.gain * fractions.sampled(z, sample_time) / z
    return 1 / (1 + gains.response(z, sample_time) * plant)
