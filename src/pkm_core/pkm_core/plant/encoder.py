"""Linear encoder of one joint: glass scale, interpolator and counter; 0.2 um per count (thesis section 6.2)."""

import math

from numba import njit


@njit(cache=True, error_model='numpy')
def encoder_count(position, resolution, signal_period, subdivision_error, noise):
    """
    Return the count (a whole float) read at `position` [m], which includes the offset of the reference mark.

    The interpolator divides a sine and a cosine of `signal_period` [m]. Unequal offsets give an error of amplitude
    `subdivision_error` [m] once per period, unequal gains one of half that amplitude twice per period. `noise` [counts]
    is added before the counter, which rounds down.
    """
    angle = 2.0 * math.pi * position / signal_period
    error = subdivision_error * (math.sin(angle) + 0.5 * math.sin(2.0 * angle))
    return math.floor((position + error) / resolution + noise)
