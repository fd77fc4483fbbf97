"""References sampled at the servo rate, their conversion from poses to joints, and the checks against a machine."""

from dataclasses import dataclass

import numpy as np

from pkm_core.errors import TrajectoryError, WorkspaceError
from pkm_core.jet import Jet
from pkm_core.motion.reach import refuse_pose

AT_HOME = 1e-6  # m; a cycle begins where the one before has ended, but for rounding
DERIVATIVES = ('position', 'velocity', 'acceleration', 'jerk')


@dataclass(frozen=True)
class SampledTrajectory:
    """
    One motion cycle: one row per sample, one column per coordinate; sample k is at the time k sample_time.

    A move is at rest at its start sample and at its target at its end sample; settling is measured from the end sample.

    Raises
    ------
    TrajectoryError
        At construction, if shapes disagree, a value is not finite or the moves are not in order.

    """

    sample_time: float  # [s]
    coordinates: tuple[str, ...]
    position: np.ndarray  # (N, n) [m, rad]
    velocity: np.ndarray  # (N, n) [m/s, rad/s]
    acceleration: np.ndarray  # (N, n) [m/s^2, rad/s^2]
    jerk: np.ndarray  # (N, n) [m/s^3, rad/s^3]
    move_starts: np.ndarray  # (moves,) [samples]
    move_ends: np.ndarray  # (moves,) [samples]

    def __post_init__(self):
        shape = (len(self.position), len(self.coordinates))
        for name in DERIVATIVES:
            values = getattr(self, name)
            if values.shape != shape:
                raise TrajectoryError(f'trajectory: {name} has shape {values.shape}; expected {shape}')
            if not np.isfinite(values).all():
                sample, column = np.argwhere(~np.isfinite(values))[0]
                raise TrajectoryError(
                    f'trajectory: {name} of {self.coordinates[column]} at sample {sample} is {values[sample, column]}; '
                    f'expected a finite number'
                )
        starts, ends = np.asarray(self.move_starts), np.asarray(self.move_ends)
        in_order = starts.shape == ends.shape and starts.size > 0 and (starts < ends).all()
        if not (in_order and starts[0] >= 0 and ends[-1] < shape[0] and (ends[:-1] <= starts[1:]).all()):
            raise TrajectoryError(
                f'trajectory: moves from samples {starts.tolist()} to {ends.tolist()}; '
                f'expected at least one move, in order, within 0 to {shape[0] - 1}'
            )

    def __len__(self):
        return len(self.position)

    def derivatives(self):
        """Return (position, velocity, acceleration, jerk)."""
        return tuple(getattr(self, name) for name in DERIVATIVES)


def to_joints(machine, trajectory):
    """
    Return the joint trajectory of a pose trajectory by `machine.inverse`, exact up to the jerk.

    Raises
    ------
    TrajectoryError
        If the trajectory has other coordinates or another sample time, or a joint exceeds its speed or thrust.
    WorkspaceError
        If a pose is out of reach or outside the travel of a joint; the sample is named.

    """
    if trajectory.coordinates != machine.coordinates:
        raise TrajectoryError(f'trajectory: coordinates {trajectory.coordinates}; expected {machine.coordinates}')
    try:
        machine.check_pose(trajectory.position)
    except WorkspaceError:
        _refuse_sample(machine, trajectory.position)
        raise
    joints = machine.inverse(Jet.from_derivatives(*trajectory.derivatives()))
    return checked_joints(machine, with_derivatives(trajectory, machine.joints, joints))


def _refuse_sample(machine, poses):
    """Raise the `WorkspaceError` of the first of `poses` (N, m) that is out of reach, seen from the one before."""
    start = machine.forward(machine.home)
    for sample, pose in enumerate(poses):
        try:
            machine.check_pose(pose)
        except WorkspaceError as error:
            raise refuse_pose(machine, f'trajectory: sample {sample}', pose, start, error) from None
        start = pose


def with_derivatives(trajectory, coordinates, jet):
    """Return `trajectory` in other coordinates, whose motion is `jet` of shape (N, n)."""
    return SampledTrajectory(
        trajectory.sample_time, coordinates, *jet.derivatives(), trajectory.move_starts, trajectory.move_ends
    )


def added(trajectory, correction):
    """Return the sum of a trajectory and a `correction`, both `SampledTrajectory`s, up to the jerk."""
    rows = [row + part for row, part in zip(trajectory.derivatives(), correction.derivatives(), strict=True)]
    moves = trajectory.move_starts, trajectory.move_ends
    return SampledTrajectory(trajectory.sample_time, trajectory.coordinates, *rows, *moves)


def checked_joints(machine, trajectory):
    """
    Return the joint `trajectory` if it is within the limits of `machine`; errors as `to_joints`.

    Speed and thrust are checked at the samples, and between them from the differences of positions: a jump from one
    sample to the next has no derivatives. The thrust is that of the nominal design, without friction and identified
    extra mass.
    """
    if trajectory.sample_time != machine.sample_time:
        raise TrajectoryError(
            f'trajectory: sample time {trajectory.sample_time * 1e3:g} ms; {machine.name} runs at '
            f'{machine.sample_time * 1e3:g} ms'
        )
    machine.check_joints(trajectory.position)
    position, velocity, acceleration, _ = trajectory.derivatives()
    _check_size(machine, velocity, machine.limits.speed, 'moves at', 'm/s', 3)
    _check_size(
        machine, machine.inverse_dynamics(position, velocity, acceleration), machine.limits.thrust, 'needs', 'N', 1
    )
    _check_between_samples(machine, position)
    return trajectory


def checked_cycle(machine, trajectory, start=None, *, stay=False, tolerance=AT_HOME):
    """
    Return the joint `trajectory` if it can be run as a cycle: within the limits, from where the machine stands.

    Parameters
    ----------
    machine : Machine
        Has the limits.
    trajectory : SampledTrajectory
        In joints.
    start : ndarray, shape (n,), optional
        Where the machine stands [m], by default home.
    stay : bool
        Whether it may end elsewhere; otherwise it ends where it begins.
    tolerance : float
        Allowed distance of the first sample from `start` [m].

    Raises
    ------
    TrajectoryError
        As `checked_joints`, or with the joint, its distance and the allowed one.

    """
    checked_joints(machine, trajectory)
    at_home = start is None or np.array_equal(start, machine.home)
    ends = [(0, machine.home if at_home else start, 'home' if at_home else 'where the machine stands', tolerance)]
    if not stay:
        ends.append((-1, ends[0][1] if at_home else trajectory.position[0], ends[0][2], AT_HOME))
    for sample, place, name, allowed in ends:
        off = trajectory.position[sample] - place
        column = int(np.argmax(np.abs(off)))
        if abs(off[column]) > allowed:
            raise TrajectoryError(
                f'trajectory: {machine.joints[column]} is {off[column] * 1e3:.4g} mm from {name} at the '
                f'{"first" if sample == 0 else "last"} sample; allowed {allowed * 1e6:g} um'
            )
    return trajectory


def _check_between_samples(machine, position):
    """Refuse positions (N, n) whose differences exceed speed or thrust, by their mean over a sample or two."""
    time, step = machine.sample_time, np.diff(position, axis=0)
    _check_size(machine, step / time, machine.limits.speed, 'to the next moves at', 'm/s', 3)
    if len(step) > 1:
        velocity, acceleration = 0.5 * (step[1:] + step[:-1]) / time, np.diff(step, axis=0) / time**2
        thrust = machine.inverse_dynamics(position[1:-1], velocity, acceleration)
        _check_size(machine, thrust, machine.limits.thrust, 'and its neighbours need', 'N', 1)


def _check_size(machine, values, limit, verb, unit, digits):
    size = np.abs(values)
    if (size > limit).any():
        sample, column = np.argwhere(size > limit)[0]
        raise TrajectoryError(
            f'trajectory: {machine.joints[column]} at sample {sample} {verb} {size[sample, column]:.{digits}f} {unit}; '
            f'allowed {limit:g} {unit}'
        )
