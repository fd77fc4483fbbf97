"""Amplitude spectrum of an error."""

import numpy as np


def amplitude_spectrum(values, sample_time):
    """
    Return (frequencies [Hz], amplitudes) of the Fourier series of a cycle.

    A cycle begins and ends at rest at the same position, so it is one period and needs no window. A sine of amplitude a
    with a whole number of periods has the value a.

    Parameters
    ----------
    values : array_like, shape (N, n)
        One column per axis.
    sample_time : float
        Sample time [s].

    Examples
    --------
    >>> time = np.arange(8) * 0.125
    >>> frequency, amplitude = amplitude_spectrum(3.0 * np.sin(2 * np.pi * 2.0 * time)[:, None] + 1.0, 0.125)
    >>> frequency
    array([0., 1., 2., 3., 4.])
    >>> amplitude[:, 0].round(9)
    array([1., 0., 3., 0., 0.])

    """
    values = np.asarray(values, dtype=np.float64)
    length = len(values)
    amplitude = 2.0 * np.abs(np.fft.rfft(values, axis=0)) / length
    amplitude[0] /= 2.0  # the mean and, for an even length, the highest frequency have no negative frequency
    if length % 2 == 0:
        amplitude[-1] /= 2.0
    return np.fft.rfftfreq(length, sample_time), amplitude
