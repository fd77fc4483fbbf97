"""Messages to arrays and back."""

from array import array

import numpy as np
from builtin_interfaces.msg import Time

from pkm_core.errors import TrajectoryError
from pkm_core.trajectory import SampledTrajectory
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage

_DERIVATIVES = ('position', 'velocity', 'acceleration', 'jerk')


def time_of_tick(tick, sample_time):
    """Return the simulated time of `tick` as builtin_interfaces/Time."""
    nanoseconds = nanoseconds_of_tick(tick, sample_time)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def nanoseconds_of_tick(tick, sample_time):
    """Return the simulated time of `tick` in whole nanoseconds."""
    return tick * round(sample_time * 1e9)


def trajectory_to_msg(trajectory, *, cycle, motion, learning_law):
    """Return `trajectory` as a message for `cycle`."""
    message = SampledTrajectoryMessage(
        cycle=cycle,
        motion=motion,
        learning_law=learning_law,
        sample_time=trajectory.sample_time,
        coordinates=list(trajectory.coordinates),
        move_starts=[int(i) for i in trajectory.move_starts],
        move_ends=[int(i) for i in trajectory.move_ends],
    )
    for name in _DERIVATIVES:
        setattr(message, name, array('d', np.ascontiguousarray(getattr(trajectory, name)).tobytes()))
    return message


def trajectory_from_msg(message, *, coordinates, sample_time):
    """
    Return the trajectory in `message`.

    Raises
    ------
    TrajectoryError
        If it is not one for `coordinates` at `sample_time`, its arrays do not fit together, or a value is not finite.

    """
    where = f'trajectory of cycle {message.cycle}'
    if tuple(message.coordinates) != tuple(coordinates):
        raise TrajectoryError(f'{where}: has coordinates {list(message.coordinates)}; expected {list(coordinates)}')
    if message.sample_time != sample_time:
        raise TrajectoryError(f'{where}: has a sample time of {message.sample_time} s; expected {sample_time} s')
    columns, arrays = len(coordinates), {}
    length = len(message.position)
    if length == 0 or length % columns:
        raise TrajectoryError(f'{where}: {length} position values; expected a multiple of {columns} columns')
    for name in _DERIVATIVES:
        values = np.frombuffer(getattr(message, name), dtype=float)
        if len(values) != length:
            raise TrajectoryError(f'{where}: {len(values)} {name} values; expected {length} as of position')
        if not np.isfinite(values).all():
            first = int(np.flatnonzero(~np.isfinite(values))[0])
            raise TrajectoryError(
                f'{where}: {name} of {coordinates[first % columns]} at sample {first // columns} is {values[first]}; '
                f'expected finite values'
            )
        arrays[name] = values.reshape(-1, columns)
    starts, ends = np.array(message.move_starts, dtype=int), np.array(message.move_ends, dtype=int)
    samples = length // columns
    if len(starts) != len(ends) or len(starts) == 0 or (starts >= ends).any() or (ends >= samples).any():
        raise TrajectoryError(
            f'{where}: moves from samples {starts.tolist()} to {ends.tolist()}; '
            f'expected as many starts as ends, start < end < {samples}'
        )
    return SampledTrajectory(
        sample_time=message.sample_time,
        coordinates=tuple(coordinates),
        move_starts=starts,
        move_ends=ends,
        **arrays,
    )
