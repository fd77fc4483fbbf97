"""
Rest-to-rest profiles of a move over time.

- 'p7': the polynomial of 7th degree whose derivatives up to the jerk are zero at both ends.
- 's3', 's4': switch between plus and minus one jerk (at 1/4 and 3/4) or one snap (at 1/2 and at sin^2 and cos^2 of
  22.5 deg). They are time-optimal for that limit alone.
- 'ruckig': time-optimal for limits of speed, acceleration and jerk together, computed by the library of that name.
"""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from pkm_core.config import Config, quantity
from pkm_core.errors import TrajectoryError


class MotionLimits(Config):
    """Limits of a move: of the joint that moves furthest, or along the path of a line or an arc."""

    speed: Annotated[quantity('m/s'), Field(gt=0)] | None = None
    acceleration: Annotated[quantity('m/s^2'), Field(gt=0)] | None = None
    jerk: Annotated[quantity('m/s^3'), Field(gt=0)] | None = None
    snap: Annotated[quantity('m/s^4'), Field(gt=0)] | None = None

    @model_validator(mode='after')
    def _limit_something(self):
        if not any(value for _, value in self):
            raise ValueError(f'expected at least one of {list(type(self).model_fields)}')
        return self


def _p7(s):
    return (
        s**4 * (35 - s * (84 - s * (70 - s * 20))),
        s**3 * (140 - s * (420 - s * (420 - s * 140))),
        s**2 * (420 - s * (1680 - s * (2100 - s * 840))),
        s * (840 - s * (5040 - s * (8400 - s * 4200))),
    )


def _s3(s):
    mirrored = np.minimum(s, 1 - s)  # the second half is the first one reversed
    ramp = np.maximum(mirrored - 0.25, 0)
    position = 16 / 3 * mirrored**3 - 32 / 3 * ramp**3
    acceleration = 32 * mirrored - 64 * ramp
    jerk = np.select([s < 0.25, s < 0.75, s < 1], [32.0, -32.0, 32.0], 0.0)
    late = s > 0.5
    velocity = 16 * mirrored**2 - 32 * ramp**2
    return np.where(late, 1 - position, position), velocity, np.where(late, -acceleration, acceleration), jerk


_S4_SWITCH = np.sin(np.pi / 8) ** 2


def _s4(s):
    mirrored = np.minimum(s, 1 - s)
    ramp = np.maximum(mirrored - _S4_SWITCH, 0)
    position, velocity, acceleration, jerk = (
        factor * (mirrored**power - 2 * ramp**power) for factor, power in ((16, 4), (64, 3), (192, 2), (384, 1))
    )
    late = s > 0.5
    return np.where(late, 1 - position, position), velocity, np.where(late, -acceleration, acceleration), jerk


_SHAPES = {'p7': _p7, 's3': _s3, 's4': _s4}
PROFILES = (*_SHAPES, 'ruckig')
_PEAKS = {  # largest speed, acceleration, jerk and snap of a move over 1 in time 1
    'p7': (35 / 16, 84 / 25 * np.sqrt(5), 52.5, 840.0),
    's3': (2.0, 8.0, 32.0, np.inf),
    's4': (8 - 4 * np.sqrt(2), 96 * (1.5 - np.sqrt(2)), 192 * (np.sqrt(2) - 1), 384.0),
}


def unit_profile(name, s):
    """Return position and its first three derivatives to s of the profile 'p7', 's3' or 's4' at `s` in [0, 1]."""
    return _SHAPES[name](np.asarray(s, dtype=np.float64))


def fixed_profile(name, samples):
    """Return `unit_profile` at the `samples` + 1 instants of a move."""
    return unit_profile(name, np.arange(samples + 1) / samples)


def limited_profile(name, limits, distance, sample_time, longest):
    """
    Return the fastest move over `distance` [m] within `MotionLimits`, rounded up to whole samples.

    Returns
    -------
    samples : int
    profile : tuple of four ndarrays, shape (samples + 1,)
        As `fixed_profile`.

    Raises
    ------
    TrajectoryError
        If the move would take more than `longest` [s], or a limited derivative of the profile is not bounded.

    """
    if name == 'ruckig':
        return _ruckig(limits, distance, sample_time, longest)
    duration = sample_time
    for order, (peak, (limited, limit)) in enumerate(zip(_PEAKS[name], limits, strict=True), start=1):
        if limit is not None and np.isinf(peak):
            raise TrajectoryError(f'limits: {limited}: profile {name} has no bounded {limited}; allowed: s4, p7')
        if limit is not None:
            duration = max(duration, (peak * distance / limit) ** (1 / order))
    _check_duration(duration, distance, longest)
    samples = int(np.ceil(duration / sample_time - 1e-9))  # rounding does not add a sample to a whole number
    return samples, fixed_profile(name, samples)


def _check_duration(duration, distance, longest):
    """Refuse a move that takes too long before its samples are computed."""
    if not duration <= longest:
        raise TrajectoryError(
            f'limits: a move over {distance * 1e3:.4g} mm would take {duration:.4g} s; allowed {longest:g} s'
        )


def _ruckig(limits, distance, sample_time, longest):
    import ruckig

    # no move is shorter than under each limit alone; ruckig fails on very long moves
    bounds = (
        distance / limits.speed,
        (4 * distance / limits.acceleration) ** 0.5,
        (32 * distance / limits.jerk) ** (1 / 3),
    )
    _check_duration(max(bounds), distance, longest)
    task = ruckig.InputParameter(1)
    task.current_position, task.target_position = [0.0], [1.0]
    task.max_velocity = [limits.speed / distance]
    task.max_acceleration = [limits.acceleration / distance]
    task.max_jerk = [limits.jerk / distance]
    task.duration_discretization = ruckig.DurationDiscretization.Discrete  # whole samples
    plan = ruckig.Trajectory(1)
    try:
        ruckig.Ruckig(1, sample_time).calculate(task, plan)
    except ruckig.RuckigError as error:
        reason = ' '.join(str(error).split())[:80]  # the rest of the text repeats the input
        raise TrajectoryError(f'limits: no ruckig profile over {distance * 1e3:.4g} mm: {reason}') from None
    _check_duration(plan.duration, distance, longest)
    samples = round(plan.duration / sample_time)
    phases = plan.profiles[0][0]
    time = np.minimum(np.arange(samples + 1) * sample_time, plan.duration)
    position, velocity, acceleration = np.array([plan.at_time(t) for t in time])[:, :, 0].T
    jerk = np.array(phases.j)[np.minimum(np.searchsorted(np.cumsum(phases.t), time, side='right'), 6)]
    duration = samples * sample_time
    return samples, (position, velocity * duration, acceleration * duration**2, jerk * duration**3)
