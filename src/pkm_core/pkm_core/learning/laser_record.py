"""
The error of the tool at the servo ticks, from the laser's record of one cycle.

The laser has its own clock (0.8 ms; a tick is 0.5 ms) and rounds to 0.91 um. Resampling must add neither delay nor
gain, because a learning law would learn it:

1. The reference is evaluated at the times of the laser samples, by cubic Hermite polynomials through its positions and
   speeds (exact to 1 nm). The difference to the measurement is the error; the measurement is not interpolated.
2. The harmonics of the cycle up to the end of the band are fitted to the error by least squares at the actual sample
   times. The fit is exact for a periodic signal within the band, whatever the ratio of the clocks is.
3. The series is evaluated at the ticks.

Rounding and noise of a sample enter as noise. A moving tool crosses many steps, so rounding errors are independent
from sample to sample; at rest the noise of the laser, 0.2 um, is the dither. With K samples and M harmonics the noise
of a sample is multiplied by sqrt((2 M + 1)/K).

The normal equations of the fit are Toeplitz: entry (k, l) is the sum of exp(-i (k - l) w t) over the samples. With at
most `largest_gap` between samples they are well conditioned.
"""

import numpy as np

from pkm_core.errors import LearningError
from pkm_core.machines.laser_clock import nanoseconds


def cycle_times(machine, time, first_tick):
    """
    Return the times (K,) [s] of laser samples since tick `first_tick`; `time` (K,) is since tick 0 [s].

    The difference is formed in whole nanoseconds, so it does not depend on the age of the cell.
    """
    whole = np.round(np.asarray(time, dtype=np.float64) * 1e9).astype(np.int64)
    return (whole - first_tick * nanoseconds(machine.sample_time)) * 1e-9


def check_record(time, displacement, duration, coordinates, largest_gap):
    """
    Raise `LearningError` unless the record covers a cycle of `duration` [s].

    Parameters
    ----------
    time : ndarray, shape (K,)
        Since the start of the cycle [s].
    displacement : ndarray, shape (K, m)
        [m, rad]
    duration, largest_gap : float
        [s]
    coordinates : tuple of str
        Names of the m columns.

    """
    if not time.size:
        raise LearningError(f'laser: no sample in a cycle of {1e3 * duration:g} ms')
    if displacement.shape != (time.size, len(coordinates)):
        raise LearningError(
            f'laser: displacement has shape {displacement.shape}; expected ({time.size}, {len(coordinates)})'
        )
    if not np.isfinite(displacement).all():
        row, column = np.argwhere(~np.isfinite(displacement))[0]
        raise LearningError(
            f'laser: {coordinates[column]} is {displacement[row, column]} at {1e3 * time[row]:.1f} ms of the cycle; '
            f'expected a finite number'
        )
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0))
        raise LearningError(
            f'laser: a sample at {1e3 * time[row + 1]:.1f} ms follows one at {1e3 * time[row]:.1f} ms of the cycle; '
            f'expected rising times'
        )
    edges = np.concatenate([[0.0], time, [duration]])
    gap = int(np.argmax(np.diff(edges)))
    if edges[gap + 1] - edges[gap] > largest_gap:
        raise LearningError(
            f'laser: no sample from {1e3 * edges[gap]:.1f} to {1e3 * edges[gap + 1]:.1f} ms of the cycle; '
            f'allowed gaps up to {1e3 * largest_gap:g} ms'
        )


def at_home(trajectory, time):
    """Return which of `time` (K,) [s] are in the rest at home: before the first move and late after the last."""
    begins, ends = trajectory.move_starts[0], 0.5 * (trajectory.move_ends[-1] + len(trajectory))
    tick = np.asarray(time) / trajectory.sample_time
    return (tick < max(begins, 1)) | (tick >= ends)


def error_samples(poses, time, displacement):
    """
    Return the error (K, m) [m, rad], reference minus measurement, at the times `time` (K,) [s] of the laser.

    The datum of the laser is unknown: the mean of the rest at home is subtracted.
    """
    h = poses.sample_time
    row = np.clip((time / h).astype(int), 0, len(poses) - 1)
    following = np.minimum(row + 1, len(poses) - 1)
    share = (time / h - row)[:, np.newaxis]
    rest = 1.0 - share
    p, v = poses.position, poses.velocity
    reference = (
        rest**2 * (1.0 + 2.0 * share) * p[row]
        + share**2 * (1.0 + 2.0 * rest) * p[following]
        + h * share * rest * (rest * v[row] - share * v[following])
    )
    error = reference - displacement
    return error - error[at_home(poses, time)].mean(axis=0)


def at_ticks(time, values, samples, sample_time, highest):
    """
    Return periodic `values` (K, m), given at `time` (K,) [s], at the `samples` ticks of the cycle: (N, m).

    The harmonics of the cycle up to `highest` [Hz] are fitted by least squares.
    """
    from scipy.linalg import solve_toeplitz  # half a second, which most nodes do not need

    period = samples * sample_time
    harmonics = int(highest * period)
    turn = -2j * np.pi * time / period
    sums = np.array([np.exp(k * turn).sum() for k in range(2 * harmonics + 1)])
    right = np.array([(np.exp(k * turn)[:, np.newaxis] * values).sum(axis=0) for k in range(harmonics + 1)])
    right = np.concatenate([right[:0:-1].conj(), right])  # harmonics -M to M
    series = np.zeros((samples // 2 + 1, values.shape[1]), dtype=complex)
    series[: harmonics + 1] = solve_toeplitz(sums, right)[harmonics:]
    return np.fft.irfft(samples * series, samples, axis=0)
