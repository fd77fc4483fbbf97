"""
Motions (config/motions/<name>.yaml or a list of poses) and their plan as a pose trajectory.

A motion leaves home, visits its targets in order and returns home: it can be repeated and learned. With `stay` it
leaves the place where the machine stands and ends at its last target. All joints of a move start and stop together. A
move is a straight line in joint space ('by', 'pose'), or a line or an arc of the end point. Every move has a rest
before it and one after it. The rest before it is needed because the learning signal may begin before the move and the
cycle boundary must lie inside a rest.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pkm_core.config import Angle, Config, Length, Time, find_config, load_config, read_yaml
from pkm_core.errors import TrajectoryError
from pkm_core.jet import Jet
from pkm_core.machines.base import ROUNDING
from pkm_core.motion.profiles import PROFILES, MotionLimits, fixed_profile, limited_profile
from pkm_core.motion.targets import check_absent, joints_of_path, path_of, target_joints
from pkm_core.motion.trajectory import DERIVATIVES, SampledTrajectory, checked_joints, with_derivatives

LONGEST_CYCLE = 20.0  # [s] of moves and rests; the trajectory message then has 5 MB


class Pose(Config):
    """Pose of the end-effector: exactly the coordinates of the machine."""

    x: Length
    y: Length
    z: Length | None = None
    phi: Angle | None = None


class ArcTarget(Config):
    """An arc of the end point."""

    to: Annotated[Pose, Field(description='pose at the end of the arc')]
    via: Annotated[Pose, Field(description='point on the arc, without phi')]


class Target(Config):
    """One move: exactly one of `by`, `pose`, `line`, `arc`."""

    by: (
        Annotated[
            dict[str, Length],
            Field(description='displacement from the previous position; a joint not named does not move'),
        ]
        | None
    ) = None
    pose: Annotated[Pose, Field(description='pose at the end of a move that is straight in joint space')] | None = None
    line: Annotated[Pose, Field(description='pose at the end of a line of the end point')] | None = None
    arc: Annotated[ArcTarget, Field(description='an arc of the end point')] | None = None

    @model_validator(mode='after')
    def _is_one_thing(self):
        if sum(value is not None for _, value in self) != 1:
            raise ValueError("expected exactly one of 'by' (joint displacements), 'pose', 'line', 'arc'")
        return self


class Motion(Config):
    """A motion of one machine: home, the targets in order, home; with `stay` from anywhere, without the way home."""

    machine: Annotated[str, Field(description='name of the machine')]
    targets: Annotated[tuple[Target, ...], Field(min_length=1)]
    move_time: Annotated[Time, Field(gt=0, description='of every move, Tp of the thesis; not used with limits')] = 70e-3
    limits: (
        Annotated[MotionLimits, Field(description='instead of a move time: each move as fast as the limits allow')]
        | None
    ) = None
    lead_rest: Annotated[Time, Field(ge=0, description='before a move')] = 20e-3
    settle_window: Annotated[Time, Field(gt=0, description='after a move')] = 80e-3
    profile: Annotated[Literal[*PROFILES], Field(description='shape of a move over time')] = 'p7'
    stay: Annotated[
        bool, Field(description='begin where the machine stands and end at the last target, without the way home')
    ] = False

    @model_validator(mode='after')
    def _timing_is_clear(self):
        if self.limits is not None and 'move_time' in self.model_fields_set:
            raise ValueError("both 'move_time' and 'limits' given; expected one of them")
        if self.limits is None:
            moves = len(self.targets) + (not self.stay)  # the way home is one
            _check_duration(moves, self.move_time, self.lead_rest, self.settle_window)
        if self.profile == 'ruckig':
            limits = self.limits
            if limits is None or None in (limits.speed, limits.acceleration, limits.jerk) or limits.snap is not None:
                raise ValueError("profile 'ruckig' takes exactly the limits speed, acceleration and jerk")
        return self


def _check_duration(moves, move_time, lead_rest, settle_window):
    duration = moves * (move_time + lead_rest + settle_window)
    if duration > LONGEST_CYCLE:
        raise TrajectoryError(
            f'move time is {move_time:g} s; with their rests the {moves} moves of a cycle take {duration:g} s; '
            f'allowed up to {LONGEST_CYCLE:g} s'
        )


def load_motion(name_or_path, configuration=None):
    """Return the `Motion` of config/motions/NAME.yaml or of a path; default configuration: of the environment."""
    return load_config(find_config('motions', name_or_path, configuration), Motion)


def poses_motion(machine, poses, move_time=None, rest_time=None, *, stay=False):
    """
    Return the `Motion` from home through `poses` and back home, or with `stay` to the last one.

    `poses` (m, n) has one row per pose in the order of `machine.coordinates` [m, rad]; `move_time` is the duration of
    one move [s], by default that of `Motion`. `rest_time` is the duration of the rest between two moves [s], by default
    lead rest and settle window of `Motion`.
    """
    poses, names = np.asarray(poses, dtype=np.float64), machine.coordinates
    if poses.ndim != 2 or poses.shape[0] == 0 or poses.shape[1] != len(names):
        raise TrajectoryError(f'poses have shape {poses.shape}; expected (m, {len(names)}), m >= 1')
    if not np.isfinite(poses).all():
        row, column = np.argwhere(~np.isfinite(poses))[0]
        raise TrajectoryError(f'pose {row}: {names[column]} is {poses[row, column]}; expected a finite number')
    default = {name: Motion.model_fields[name].default for name in ('move_time', 'lead_rest', 'settle_window')}
    move_time = default['move_time'] if move_time is None else move_time
    check_move_time(move_time)
    lead, settle = default['lead_rest'], default['settle_window']
    if rest_time is not None:
        if not lead < rest_time < np.inf:
            raise TrajectoryError(f'rest time is {rest_time} s; expected more than {lead:g} s')
        settle = rest_time - lead
    _check_duration(len(poses) + (not stay), move_time, lead, settle)
    targets = tuple(Target(pose=Pose(**dict(zip(names, row, strict=True)))) for row in poses.tolist())
    return Motion(machine=machine.name, targets=targets, move_time=move_time, settle_window=settle, stay=stay)


def check_move_time(move_time):
    """Refuse a `move_time` [s] that is not positive and finite."""
    if not 0 < move_time < np.inf:
        raise TrajectoryError(f'move time is {move_time} s; expected a positive number')


def pose_rows(machine, poses):
    """
    Return `poses`, a list of {coordinate: value [m, rad]}, as rows (m, n) in the order of `machine.coordinates`.

    Raises
    ------
    TrajectoryError
        If a coordinate that the machine lacks is not 0.

    """
    for row, pose in enumerate(poses):
        check_absent(f'pose {row}', machine, pose)
    return np.array([[pose[name] for name in machine.coordinates] for pose in poses])


def still_moves(machine, trajectory):
    """Return a sentence on the moves of a joint or pose trajectory in which nothing moves, '' if there is none."""
    spans = zip(trajectory.move_starts, trajectory.move_ends, strict=True)
    still = [n for n, (a, b) in enumerate(spans, 1) if np.ptp(trajectory.position[a : b + 1], axis=0).max() < ROUNDING]
    if not still:
        return ''
    return f'{machine.name}: nothing moves in {len(still)} of {len(trajectory.move_starts)} moves: {still[:10]}'


def plan(machine, motion, check=None, start=None):
    """
    Return the pose trajectory of one cycle of `motion`.

    `start` (n,) [m] is where the machine stands, by default home. A motion without `stay` begins and ends at home.

    `check(trajectory)` raises a `TrajectoryError` for a trajectory in joints that is refused for another reason than
    the limits of the machine, such as `drive_check` of pkm_core.control.

    Raises
    ------
    TrajectoryError
        If the motion is for another machine, has an unknown joint or coordinate, a duration that is not a multiple of
        the sample time or an arc without a circle, or a joint exceeds the limit of speed or thrust; without `stay`, if
        the machine does not stand at home.
    WorkspaceError
        If a target or a point of a path is out of reach.

    """
    if motion.machine != machine.name:
        raise TrajectoryError(f'motion is for {motion.machine}; the machine is {machine.name}')
    start = _start(machine, motion, start)
    joints = _joint_trajectory(machine, motion, start)
    try:
        _check_limits(machine, joints, check)
    except TrajectoryError as error:
        raise TrajectoryError(f'{error}{_advice(machine, motion, start, check)}') from None
    return with_derivatives(joints, machine.coordinates, machine.forward(Jet.from_derivatives(*joints.derivatives())))


def _start(machine, motion, start):
    """Return the joint positions (n,) [m] at the first sample; `start` may be None."""
    if start is None:
        return machine.home
    off = start - machine.home
    column = int(np.argmax(np.abs(off)))
    if not motion.stay and abs(off[column]) > ROUNDING:
        raise TrajectoryError(
            f'motion: begins and ends at home; the machine stands elsewhere, {machine.joints[column]} by '
            f'{off[column] * 1e3:.4g} mm; call the action home first, or give stay'
        )
    return start if motion.stay else machine.home


def _check_limits(machine, joints, check):
    checked_joints(machine, joints)
    if check is not None:
        check(joints)


def _advice(machine, motion, start, check):
    """Return a hint for a motion that is too fast: the shortest move time within the limits of the machine."""
    if motion.limits is not None:
        return ''
    return f'; shortest allowed move_time: {shortest_move_time(machine, motion, start, check) * 1e3:g} ms'


def shortest_move_time(machine, motion, start, check=None):
    """Return the shortest `move_time` [s] for `motion` from `start` (n,) [m], above that of `motion`; see `plan`."""
    shortest, longest = _samples(machine, motion, 'move_time'), round(LONGEST_CYCLE / 4 / machine.sample_time)
    while shortest + 1 < longest:
        samples = (shortest + longest) // 2
        try:
            slower = motion.model_copy(update={'move_time': samples * machine.sample_time})
            _check_limits(machine, _joint_trajectory(machine, slower, start), check)
            longest = samples
        except TrajectoryError:
            shortest = samples
    return longest * machine.sample_time


def _joint_trajectory(machine, motion, start):
    lead, settle = (_samples(machine, motion, name) for name in ('lead_rest', 'settle_window'))
    rest = np.zeros((3, len(machine.joints)))
    rows, starts, ends = [[] for _ in DERIVATIVES], [], []
    position, done = start, 0
    for index, target in enumerate(motion.targets if motion.stay else (*motion.targets, None)):
        where = 'motion: way home' if target is None else f'motion: target {index}'
        if target is None and np.abs(position - machine.home).max() < ROUNDING:
            break  # the last target was home
        move = _move(machine, motion, where, target, position)
        samples = len(move[0]) - 1
        starts.append(done + lead)
        ends.append(done + lead + samples)
        done = ends[-1] + settle
        if done * machine.sample_time > LONGEST_CYCLE:
            raise TrajectoryError(
                f'{where}: the cycle takes {done * machine.sample_time:g} s up to here; allowed {LONGEST_CYCLE:g} s'
            )
        for column, values, standing in zip(rows, move, (None, *rest), strict=True):
            before, after = (position, move[0][-1]) if standing is None else (standing, standing)
            column += [np.tile(before, (lead, 1)), values[:-1], np.tile(after, (settle, 1))]
        position = move[0][-1]
    columns = (np.concatenate(parts) for parts in rows)
    return SampledTrajectory(machine.sample_time, machine.joints, *columns, np.array(starts), np.array(ends))


def _move(machine, motion, where, target, position):
    """Return joint position, velocity, acceleration and jerk (m + 1, n) of one move from `position` (n,)."""
    if target is not None and target.by is None and target.pose is None:
        path = path_of(machine, where, target, position)
        duration, profile = _timing(machine, motion, where, path.length)
        s = Jet.from_derivatives(*(shape / duration**order for order, shape in enumerate(profile)))
        return joints_of_path(machine, where, path.at(s), position).derivatives()
    end = machine.home if target is None else target_joints(machine, where, target, position)
    change = end - position
    duration, profile = _timing(machine, motion, where, np.abs(change).max())
    move = [shape[:, None] * change / duration**order for order, shape in enumerate(profile)]
    return [position + move[0], *move[1:]]


def _timing(machine, motion, where, distance):
    """Return duration [s] and unit profile of a move over `distance` [m]."""
    if motion.limits is None:
        return motion.move_time, fixed_profile(motion.profile, _samples(machine, motion, 'move_time'))
    if not distance > ROUNDING:
        raise TrajectoryError(f'{where}: no length changes; limits give no duration; give move_time instead')
    samples, profile = limited_profile(motion.profile, motion.limits, distance, machine.sample_time, LONGEST_CYCLE)
    return samples * machine.sample_time, profile


def _samples(machine, motion, name):
    """Return the duration `name` of `motion` in samples."""
    duration = getattr(motion, name)
    samples = round(duration / machine.sample_time)
    if abs(samples * machine.sample_time - duration) > 1e-9:  # s; far below a sample, far above rounding
        raise TrajectoryError(
            f'motion: {name} is {duration * 1e3:g} ms; expected a multiple of {machine.sample_time * 1e3:g} ms'
        )
    if samples == 0 and name != 'lead_rest':
        raise TrajectoryError(f'motion: {name} is {duration:g} s; expected at least {machine.sample_time * 1e3:g} ms')
    return samples


def default_motion(machine):
    """Return the name of the first motion of config/motions that is for `machine`."""
    machine.dynamic_parameters()  # a machine without dynamics is refused by its own reason
    for name in machine.configuration.names('motions'):
        if read_yaml(machine.configuration.find('motions', name)).get('machine') == machine.name:
            return name
    raise TrajectoryError(f'no motion in {machine.configuration.folder / "motions"} is for machine {machine.name!r}')
