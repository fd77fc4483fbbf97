"""
A trajectory of joint positions over time, as a trajectory_msgs/JointTrajectory gives it, sampled at the servo rate.

The points are joined as the JointTrajectoryController of ros2_controllers does: linearly if they give positions only,
by cubic polynomials with velocities, by quintic ones with accelerations too. Before and after it the machine rests.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from pkm_core.errors import FollowError, TrajectoryError, WorkspaceError
from pkm_core.motion.planning import LONGEST_CYCLE, Motion
from pkm_core.motion.reach import refuse_joints
from pkm_core.motion.trajectory import SampledTrajectory

# [m] chosen: far above the error of a standing axis (2 um); a client reads the start from the encoders
START_TOLERANCE = 100e-6
_VALUES = ('positions', 'velocities', 'accelerations')


@dataclass(frozen=True)
class Point:
    """One point of a command; an empty sequence is not given."""

    time: float  # [s] from the start
    positions: tuple[float, ...]  # [m]
    velocities: tuple[float, ...] = ()  # [m/s]
    accelerations: tuple[float, ...] = ()  # [m/s^2]
    effort: tuple[float, ...] = ()  # [N]


def sampled_command(machine, names, points, start):
    """
    Return the `SampledTrajectory` in joints of a command.

    Limits of speed, thrust and drive are checked by the caller, see `checked_joints` and `drive_check`.

    Parameters
    ----------
    machine : Machine
        Has joints, sample time and travel.
    names : sequence of str
        Joints in the order of the values of a point: those of the machine, in any order.
    points : sequence of Point
        In the order of their times. A first point after 0 s is reached from `start`; one at 0 s has to be `start`.
    start : ndarray, shape (n,)
        Joint positions where the machine stands [m].

    Raises
    ------
    TrajectoryError
        If names, times, numbers of values, the start, the end or the duration are refused.
    WorkspaceError
        If a point is out of reach.

    """
    names = list(names)
    if sorted(names) != sorted(machine.joints):
        raise FollowError(
            'INVALID_JOINTS', f'joint trajectory: joint names {names}; expected each of {list(machine.joints)} once'
        )
    if not points:
        raise TrajectoryError('joint trajectory: 0 points; expected at least 1')
    order = [names.index(joint) for joint in machine.joints]
    given = _values_given(points, len(names))
    times = _times(points)
    values = np.array([[getattr(point, name) for name in given] for point in points], dtype=float)[:, :, order]
    if not np.isfinite(values).all():
        point, kind, column = np.argwhere(~np.isfinite(values))[0]
        raise TrajectoryError(
            f'joint trajectory: point {point}: {given[kind]} of {machine.joints[column]} is '
            f'{values[point, kind, column]}; expected a finite number'
        )
    times, values = _from_start(machine, times, values, start)
    _check_end(machine, values, given)
    _check_points(machine, values[:, 0], first=len(points) - len(values))
    return _sampled(machine, times, values)


def _values_given(points, joints):
    """Return the names of the values that every point gives."""
    for number, point in enumerate(points):
        for name in (*_VALUES, 'effort'):
            size, allowed = len(getattr(point, name)), (joints,) if name == 'positions' else (0, joints)
            if name == 'effort':
                allowed = (0,)
            if size not in allowed:
                raise TrajectoryError(
                    f'joint trajectory: point {number}: {size} {name}; expected {" or ".join(map(str, allowed))}'
                )
    given = [name for name in _VALUES if len(getattr(points[0], name))]
    for number, point in enumerate(points):
        own = [name for name in _VALUES if len(getattr(point, name))]
        if own != given:
            raise TrajectoryError(f'joint trajectory: point {number} gives {own}, point 0 {given}; expected the same')
    if given == ['positions', 'accelerations']:
        raise TrajectoryError('joint trajectory: accelerations without velocities; expected both')
    return given


def _times(points):
    times = np.array([point.time for point in points], dtype=float)
    if not np.isfinite(times).all() or times[0] < 0:
        raise TrajectoryError(f'joint trajectory: time_from_start of point 0 is {times[0]} s; allowed: 0 or more')
    for number in range(1, len(times)):
        if not times[number] > times[number - 1]:
            raise TrajectoryError(
                f'joint trajectory: time_from_start of point {number} is {times[number]:g} s, of point {number - 1} '
                f'{times[number - 1]:g} s; expected increasing times'
            )
    if not 0 < times[-1] <= LONGEST_CYCLE:
        raise TrajectoryError(
            f'joint trajectory: takes {times[-1]:g} s; allowed: more than 0, up to {LONGEST_CYCLE:g} s'
        )
    return times


def _from_start(machine, times, values, start):
    """Return times (m,) and values (m, kinds, n) of the points from `start` at 0 s on."""
    rest = np.zeros_like(values[:1])
    rest[0, 0] = start
    if times[0] > 0:
        return np.concatenate([[0.0], times]), np.concatenate([rest, values])
    off = values[0, 0] - start
    column = int(np.argmax(np.abs(off)))
    if abs(off[column]) > START_TOLERANCE:
        raise TrajectoryError(
            f'joint trajectory: begins {off[column] * 1e3:.4g} mm from where the machine stands, '
            f'{machine.joints[column]} = {start[column] * 1e3:.6g} mm; allowed {START_TOLERANCE * 1e3:g} mm'
        )
    if values[0, 1:].any():
        raise TrajectoryError('joint trajectory: point 0 at 0 s moves; expected velocities and accelerations of 0')
    return times, np.concatenate([rest, values[1:]])


def _check_end(machine, values, given):
    for kind, name in enumerate(given[1:], 1):
        column = int(np.argmax(np.abs(values[-1, kind])))
        if values[-1, kind, column] != 0:
            raise TrajectoryError(
                f'joint trajectory: last point: {name} of {machine.joints[column]} is {values[-1, kind, column]:g}; '
                f'expected 0: the machine rests there'
            )


def _check_points(machine, positions, first):
    """Refuse a point out of reach; `first` is the number of the first row in the command, -1 for the start."""
    for row in range(1, len(positions)):
        try:
            machine.check_joints(positions[row])
            machine.forward(positions[row])
        except WorkspaceError as error:
            before = positions[row - 1]
            where = f'joint trajectory: point {row + first}'
            raise refuse_joints(machine, where, before, positions[row] - before, error) from None


def _sampled(machine, times, values):
    step, default = machine.sample_time, Motion.model_fields
    lead, settle = (round(default[name].default / step) for name in ('lead_rest', 'settle_window'))
    spline = BPoly.from_derivatives(times, values)
    degree = 2 * values.shape[1] - 1
    moving = math.ceil(times[-1] / step - 1e-9)  # samples; the last one is at the end or up to one later
    at = np.minimum(step * np.arange(moving), times[-1])
    rows = []
    for order in range(4):
        before, after = (values[index, 0] if order == 0 else np.zeros(len(machine.joints)) for index in (0, -1))
        course = spline(at, order) if order <= degree else np.zeros((moving, len(machine.joints)))
        rows.append(np.concatenate([np.tile(before, (lead, 1)), course, np.tile(after, (settle + 1, 1))]))
    return SampledTrajectory(step, machine.joints, *rows, np.array([lead]), np.array([lead + moving]))


def describe_samples(machine):
    """Return how the samples of `sampled_command` count, for a refusal that names one."""
    lead = round(Motion.model_fields['lead_rest'].default / machine.sample_time)
    return f'sample {lead} is at 0 s, {machine.sample_time * 1e3:g} ms each'
