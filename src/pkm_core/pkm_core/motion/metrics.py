"""What a cycle achieved, from one axis's error r - y alone, after the thesis's tables 7.2 and 8.2."""

from dataclasses import dataclass

import numpy as np

STEADY_STATE_TIME = 10e-3  # [s] end of a rest over which the steady-state error is averaged


@dataclass(frozen=True)
class AxisMetrics:
    """One axis over one cycle, the worst of all moves in it."""

    max_dynamic_error: float  # [m] max |error| from a move's start to the end of its profile, both samples included
    settling_time_5um: float  # [s] from the profile's end until |error| <= 5 um for the rest of the rest; nan if never
    settling_time_1um: float  # [s] the same for 1 um
    steady_state_error: float  # [m] mean error of the last 10 ms of the rest after a move, with sign


def axis_metrics(error, move_starts, move_ends, sample_time):
    """
    Return the `AxisMetrics` of one cycle.

    The rest after a move ends with the sample before the next move's start, the last one with the cycle. A rest shorter
    than 10 ms is averaged as a whole.

    Parameters
    ----------
    error : array_like, shape (N,)
        r - y [m].
    move_starts, move_ends : array_like of int, shape (moves,)
        First sample of a move and the sample at which its profile has ended.
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
    """Return the longest time [s] any rest needs to stay within `tolerance` [m]; nan if one ends outside."""
    longest = 0
    for rest in rests:
        outside = np.flatnonzero(np.abs(rest) > tolerance)
        settled = 0 if outside.size == 0 else int(outside[-1]) + 1
        if settled == rest.size:
            return float('nan')
        longest = max(longest, settled)
    return longest * sample_time
