"""
Motions: what is to be driven, config/motions/<name>.yaml or a list of poses, and its plan as a pose trajectory.

A motion leaves home, visits its targets in order and returns home, so that it can be repeated and learned. All joints
of a move start and stop together. Every move has a rest before it (the learning signal may begin before the move, and
the boundary of the cycle lies inside a rest) and one after it.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pkm_core.config import Angle, Config, Length, Time, config_folder, find_config, load_config, read_yaml
from pkm_core.errors import TrajectoryError, WorkspaceError
from pkm_core.jet import Jet
from pkm_core.trajectory import DERIVATIVES, SampledTrajectory, checked_joints, unit_profile, with_derivatives


class Pose(Config):
    """Pose of the end-effector; a machine takes the coordinates it has, no more and no less."""

    x: Length
    y: Length
    z: Length | None = None
    phi: Angle | None = None


class Target(Config):
    """Where a move ends."""

    by: dict[str, Length] | None = None  # from where the machine stands; a joint not named stays
    pose: Pose | None = None

    @model_validator(mode='after')
    def _is_one_thing(self):
        if (self.by is None) == (self.pose is None):
            raise ValueError("a target is either 'by' (joint displacements) or 'pose'")
        return self


class Motion(Config):
    """A motion of one machine: home, the targets in order, home."""

    machine: str
    targets: Annotated[tuple[Target, ...], Field(min_length=1)]
    move_time: Annotated[Time, Field(gt=0)] = 70e-3  # Tp of the thesis
    lead_rest: Annotated[Time, Field(ge=0)] = 20e-3  # before a move
    settle_window: Annotated[Time, Field(gt=0)] = 80e-3  # after a move
    profile: Literal['p7', 's3'] = 'p7'


def load_motion(name_or_path):
    """Return the `Motion` of config/motions/NAME.yaml or of a path."""
    return load_config(find_config('motions', name_or_path), Motion)


def poses_motion(machine, poses, move_time=None):
    """
    Return the `Motion` from home through `poses` and back home.

    `poses` is (m, n), a row a pose in the order of `machine.coordinates` [m, rad]; `move_time` the duration of one
    move [s], by default that of `Motion`.
    """
    poses, names = np.asarray(poses, dtype=np.float64), machine.coordinates
    if poses.ndim != 2 or poses.shape[0] == 0 or poses.shape[1] != len(names):
        raise TrajectoryError(f'poses have shape {poses.shape}; expected (m, {len(names)}), m >= 1')
    if not np.isfinite(poses).all():
        row, column = np.argwhere(~np.isfinite(poses))[0]
        raise TrajectoryError(f'pose {row}: {names[column]} is {poses[row, column]}; expected a finite number')
    if move_time is not None and not 0 < move_time < np.inf:
        raise TrajectoryError(f'move time is {move_time} s; expected a positive number')
    targets = tuple(Target(pose=Pose(**dict(zip(names, row, strict=True)))) for row in poses.tolist())
    timing = {} if move_time is None else {'move_time': move_time}
    return Motion(machine=machine.name, targets=targets, **timing)


def plan(machine, motion):
    """
    Return the pose trajectory of one cycle of `motion`: straight moves of all joints, mapped by `machine.forward`.

    Raises
    ------
    TrajectoryError
        If the motion is for another machine, names a joint or coordinate it lacks, a duration is no multiple of the
        sample time, or a joint exceeds the speed limit.
    WorkspaceError
        If a target cannot be reached.

    """
    if motion.machine != machine.name:
        raise TrajectoryError(f'motion is for {motion.machine}; the machine is {machine.name}')
    joints = checked_joints(machine, _joint_trajectory(machine, motion))
    return with_derivatives(joints, machine.coordinates, machine.forward(Jet.from_derivatives(*joints.derivatives())))


def _joint_trajectory(machine, motion):
    lead, move, settle = (_samples(machine, motion, name) for name in ('lead_rest', 'move_time', 'settle_window'))
    period = lead + move + settle
    waypoints = _waypoints(machine, motion)
    moves = len(waypoints) - 1
    columns = [np.zeros((moves * period, len(machine.joints))) for _ in DERIVATIVES]
    starts = np.arange(moves) * period + lead
    profile = unit_profile(motion.profile, np.arange(move + 1) / move)
    for begin, origin, target in zip(starts, waypoints[:-1], waypoints[1:], strict=True):
        columns[0][begin - lead : begin + move] = origin
        columns[0][begin + move :] = target
        for order, (column, shape) in enumerate(zip(columns, profile, strict=True)):
            column[begin : begin + move] += shape[:-1, None] * (target - origin) / motion.move_time**order
    return SampledTrajectory(machine.sample_time, machine.joints, *columns, starts, starts + move)


def _samples(machine, motion, name):
    """Return the duration `name` of `motion` in samples."""
    duration = getattr(motion, name)
    samples = round(duration / machine.sample_time)
    if abs(samples * machine.sample_time - duration) > 1e-9:  # s; far below a sample, far above rounding
        raise TrajectoryError(
            f'motion: {name} is {duration * 1e3:g} ms; expected a multiple of {machine.sample_time * 1e3:g} ms'
        )
    return samples


def _waypoints(machine, motion):
    """Return home, the targets and home again, in joints."""
    waypoints = [machine.home]
    for index, target in enumerate(motion.targets):
        waypoints.append(_target_joints(machine, f'motion: target {index}', target, waypoints[-1]))
    return [*waypoints, machine.home]


def _target_joints(machine, where, target, position):
    if target.pose is not None:
        given = target.pose.model_dump(exclude_none=True)
        _check_names(where, given, machine.coordinates, exactly=True)
        pose = np.array([given[name] for name in machine.coordinates])
        try:
            machine.check_pose(pose)
        except WorkspaceError as error:
            raise WorkspaceError(f'{where}: {error}') from None
        return machine.inverse(pose)
    _check_names(where, target.by, machine.joints, exactly=False)
    return position + np.array([target.by.get(joint, 0.0) for joint in machine.joints])


def _check_names(where, given, known, *, exactly):
    if not set(given) <= set(known) or (exactly and set(given) != set(known)):
        raise TrajectoryError(f'{where}: names {sorted(given)}; {"expected" if exactly else "known:"} {list(known)}')


def default_motion(machine):
    """Return the name of the motion the machine is measured with: the first of config/motions that is for it."""
    for path in sorted((config_folder() / 'motions').glob('*.yaml')):
        if read_yaml(path).get('machine') == machine.name:
            return path.stem
    raise TrajectoryError(f'no motion in {config_folder() / "motions"} is for machine {machine.name!r}')
