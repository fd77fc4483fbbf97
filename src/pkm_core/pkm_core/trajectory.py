"""References sampled at the servo rate, the profiles they are made of, and their way from poses to joints."""

from dataclasses import dataclass

import numpy as np

from pkm_core.errors import TrajectoryError
from pkm_core.jet import Jet

DERIVATIVES = ('position', 'velocity', 'acceleration', 'jerk')


@dataclass(frozen=True)
class SampledTrajectory:
    """
    One motion cycle, a row a sample, a column a coordinate; sample k belongs to the time k sample_time.

    A move begins at its start sample, still at rest, and has reached its target at its end sample; settling counts from
    there. Construction refuses what does not fit together or is not finite with a `TrajectoryError`.
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
                f'expected at least one, in order, within 0 to {shape[0] - 1}'
            )

    def __len__(self):
        return len(self.position)

    def derivatives(self):
        """Return (position, velocity, acceleration, jerk)."""
        return tuple(getattr(self, name) for name in DERIVATIVES)


def _p7(s):
    return (
        s**4 * (35 - s * (84 - s * (70 - s * 20))),
        s**3 * (140 - s * (420 - s * (420 - s * 140))),
        s**2 * (420 - s * (1680 - s * (2100 - s * 840))),
        s * (840 - s * (5040 - s * (8400 - s * 4200))),
    )


def _s3(s):
    mirrored = np.minimum(s, 1 - s)  # the second half repeats the first backwards
    ramp = np.maximum(mirrored - 0.25, 0)
    position = 16 / 3 * mirrored**3 - 32 / 3 * ramp**3
    acceleration = 32 * mirrored - 64 * ramp
    jerk = np.select([s < 0.25, s < 0.75, s < 1], [32.0, -32.0, 32.0], 0.0)
    late = s > 0.5
    velocity = 16 * mirrored**2 - 32 * ramp**2
    return np.where(late, 1 - position, position), velocity, np.where(late, -acceleration, acceleration), jerk


PROFILES = {'p7': _p7, 's3': _s3}


def unit_profile(name, s):
    """
    Return position and its first three derivatives to s of the rest-to-rest profile from 0 to 1 at `s` in [0, 1].

    'p7' is the polynomial of 7th degree whose derivatives up to the jerk are zero at both ends; 's3' switches between
    plus and minus one jerk at 0, 1/4, 3/4 and 1, the fastest profile a jerk limit alone allows.
    """
    return PROFILES[name](np.asarray(s, dtype=np.float64))


def to_joints(machine, trajectory):
    """
    Return the joint trajectory of a pose trajectory: `machine.inverse`, exact up to the jerk.

    Raises
    ------
    TrajectoryError
        If the trajectory is for other coordinates or another sample time, or a joint exceeds the speed limit.
    WorkspaceError
        If a pose cannot be reached or lies outside a joint's travel; the sample is named.

    """
    if trajectory.coordinates != machine.coordinates:
        raise TrajectoryError(f'trajectory: coordinates {trajectory.coordinates}; expected {machine.coordinates}')
    machine.check_pose(trajectory.position)
    joints = machine.inverse(Jet.from_derivatives(*trajectory.derivatives()))
    return checked_joints(machine, with_derivatives(trajectory, machine.joints, joints))


def with_derivatives(trajectory, coordinates, jet):
    """Return `trajectory` with other coordinates, whose motion is `jet` of shape (N, n)."""
    return SampledTrajectory(
        trajectory.sample_time, coordinates, *jet.derivatives(), trajectory.move_starts, trajectory.move_ends
    )


def checked_joints(machine, trajectory):
    """Return the joint `trajectory` if `machine` may run it; errors as `to_joints`."""
    if trajectory.sample_time != machine.sample_time:
        raise TrajectoryError(
            f'trajectory: sample time {trajectory.sample_time * 1e3:g} ms; {machine.name} runs at '
            f'{machine.sample_time * 1e3:g} ms'
        )
    machine.check_joints(trajectory.position)
    speed = np.abs(trajectory.velocity)
    if (speed > machine.limits.speed).any():
        sample, column = np.argwhere(speed > machine.limits.speed)[0]
        raise TrajectoryError(
            f'trajectory: {machine.joints[column]} at sample {sample} moves at {speed[sample, column]:.3f} m/s; '
            f'allowed {machine.limits.speed:g} m/s'
        )
    return trajectory
