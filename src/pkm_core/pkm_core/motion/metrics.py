"""Metrics of a cycle from the error r - y of one axis, as in the thesis's tables 7.2 and 8.2."""

from dataclasses import dataclass, replace

import numpy as np

STEADY_STATE_TIME = 10e-3  # [s] end of a rest over which the steady-state error is averaged


@dataclass(frozen=True)
class AxisMetrics:
    """Metrics of one axis over one cycle, each the worst of all moves."""

    max_dynamic_error: float  # [m] max |error| from a move's start to the end of its profile, both samples included
    settling_time_5um: float  # [s] from the profile's end until |error| stays <= 5 um in the rest; nan if it does not
    settling_time_1um: float  # [s] the same for 1 um
    steady_state_error: float  # [m] signed mean error of the last 10 ms of the rest after a move

    def without_settling(self):
        """Return the metrics of a move in which nothing moves."""
        return replace(self, settling_time_5um=float('nan'), settling_time_1um=float('nan'))


def axis_metrics(error, move_starts, move_ends, sample_time):
    """
    Return the `AxisMetrics` of one cycle.

    The rest after a move ends with the sample before the next move's start, the last one with the cycle. The mean of a
    rest shorter than 10 ms is that of the whole rest.

    Parameters
    ----------
    error : array_like, shape (N,)
        r - y [m].
    move_starts, move_ends : array_like of int, shape (moves,)
        First sample of each move, and the sample at which its profile ends.
    sample_time : float
        [s]

    """
    error = np.asarray(error, dtype=np.float64)
    rest_ends = [*move_starts[1:], error.size]
    rests = [error[end:rest_end] for end, rest_end in zip(move_ends, rest_ends, strict=True)]
    averaged = max(1, round(STEADY_STATE_TIME / sample_time))
    means = [float(np.mean(rest[-averaged:])) for rest in rests]
    return AxisMetrics(
        max_dynamic_error=max(
            float(np.abs(error[start : end + 1]).max()) for start, end in zip(move_starts, move_ends, strict=True)
        ),
        settling_time_5um=_settling_time(rests, 5e-6, sample_time),
        settling_time_1um=_settling_time(rests, 1e-6, sample_time),
        steady_state_error=max(means, key=abs),
    )


def _settling_time(rests, tolerance, sample_time):
    """Return the longest time [s] in any rest until the error stays within `tolerance` [m]; nan if one ends outside."""
    longest = 0
    for rest in rests:
        outside = np.flatnonzero(np.abs(rest) > tolerance)
        settled = 0 if outside.size == 0 else int(outside[-1]) + 1
        if settled == rest.size:
            return float('nan')
        longest = max(longest, settled)
    return longest * sample_time
