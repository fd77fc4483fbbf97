"""
All margins of a loop in one compiled pass over its Nyquist curve, fast enough for a search over 100 000 loops.

Between two frequencies the curve is interpolated linearly.
"""

import math

import numpy as np
from numba import njit

# what `loop_figures` returns, in this order
FIGURES = (
    'end_angle',  # [rad] of 1 + L at the last frequency, unwrapped from the first
    'gain_margin',  # [dB] increase of the gain that reaches -1; inf if none does
    'gain_reduction',  # [dB] decrease of the gain that reaches -1
    'phase_margin',  # [deg] smallest rotation, either way, that reaches -1
    'peak_sensitivity',  # max |S|
    'disk_margin',  # 1/max |S - 1/2|: gain (2 + a)/(2 - a) and its inverse, and phase 2 atan(a/2)
    'crossover',  # [Hz] highest with |L| = 1; nan if there is none
    'bandwidth',  # [Hz] up to which |S| < 1, the CLBW of (7.29)
    'bandwidth_3db',  # [Hz] up to which |S| < 1/sqrt 2
    'tracking_bandwidth',  # [Hz] from which on |T| < 1/sqrt 2
)


@njit(cache=True)
def _passing(before, after, level):
    """Return the position between 0 and 1 at which a line from sqrt `before` to sqrt `after` crosses `level`."""
    first = math.sqrt(before)
    return (level - first) / (math.sqrt(after) - first)


@njit(cache=True)
def loop_figures(frequency, loop, gain, start_angle, out):
    """
    Write the `FIGURES` of `gain` * `loop` (m,) at the rising `frequency` (m,) [Hz] into `out`.

    `start_angle` [rad] is the approximate angle of 1 + L at the first frequency; it selects among values 2 pi apart.
    With -pi/2 for each pole of L at z = 1 and a curve from near 0 Hz to half the sampling rate, the closed loop is
    stable if and only if the end angle is 0: a polynomial with all n roots inside the unit circle turns by n pi over
    the half circle, a root at z = 1 by pi/2 less.
    """
    rise, fall, phase = np.inf, np.inf, math.pi
    crossover, bandwidth, bandwidth_3db, tracking = math.nan, math.nan, math.nan, math.nan
    x, y = gain * loop[0].real, gain * loop[0].imag
    turns = np.rint((start_angle - math.atan2(y, 1.0 + x)) / (2.0 * math.pi))
    size, distance = x * x + y * y, (1.0 + x) ** 2 + y * y  # |L|^2, |1 + L|^2
    nearest, disk = distance, ((1.0 - x) ** 2 + y * y) / distance  # |2 S - 1|^2
    for k in range(1, loop.size):
        last_x, last_y, last_size, last_distance = x, y, size, distance
        x, y = gain * loop[k].real, gain * loop[k].imag
        size, distance = x * x + y * y, (1.0 + x) ** 2 + y * y
        nearest, disk = min(nearest, distance), max(disk, ((1.0 - x) ** 2 + y * y) / distance)
        f, step = frequency[k - 1], frequency[k] - frequency[k - 1]
        if (last_y < 0.0) != (y < 0.0):
            real = last_x - last_y * (x - last_x) / (y - last_y)
            if real <= -1.0:
                fall = min(fall, -real)
                turns += 1.0 if y < 0.0 else -1.0  # the angle passes pi
            elif real < 0.0:
                rise = min(rise, -1.0 / real)
        if (last_size < 1.0) != (size < 1.0):
            t = _passing(last_size, size, 1.0)
            phase = min(phase, abs(math.atan2(last_y + t * (y - last_y), -last_x - t * (x - last_x))))
            crossover = f + t * step
        if math.isnan(bandwidth) and last_distance > 1.0 >= distance:
            bandwidth = f + _passing(last_distance, distance, 1.0) * step
        if math.isnan(bandwidth_3db) and last_distance > 2.0 >= distance:
            bandwidth_3db = f + _passing(last_distance, distance, math.sqrt(2.0)) * step
        if 2.0 * last_size >= last_distance and 2.0 * size < distance:
            tracking = f + _passing(last_size / last_distance, size / distance, math.sqrt(0.5)) * step
    out[0] = math.atan2(y, 1.0 + x) + 2.0 * math.pi * turns
    out[1], out[2] = 20.0 * math.log10(rise), 20.0 * math.log10(fall)
    out[3], out[4], out[5] = math.degrees(phase), 1.0 / math.sqrt(nearest), 2.0 / math.sqrt(disk)
    out[6], out[7], out[8], out[9] = crossover, bandwidth, bandwidth_3db, tracking
