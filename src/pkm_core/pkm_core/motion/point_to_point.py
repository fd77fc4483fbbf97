"""One move to a pose or to joint positions, from where the machine stands; the machine stays there."""

import numpy as np

from pkm_core.errors import TrajectoryError
from pkm_core.motion.planning import Motion, Target, check_move_time, plan, shortest_move_time
from pkm_core.motion.targets import check_absent, joints_of_pose


def pose_target(machine, start, values, coordinates=(), *, relative=False):
    """
    Return the joint positions (n,) [m] of a target pose.

    Parameters
    ----------
    machine : Machine
        Has the limits.
    start : ndarray, shape (n,)
        Joint positions where the machine stands [m].
    values : dict of str to float
        By coordinate [m, rad].
    coordinates : sequence of str
        Those of `values` that are used; the others keep their value at `start`. Empty: all.
    relative : bool
        Whether `values` are displacements from `start`.

    Raises
    ------
    TrajectoryError
        If a name is unknown or repeated, or a value is not finite.
    WorkspaceError
        If the pose is out of reach.

    """
    names, used = machine.coordinates, tuple(coordinates) or tuple(values)
    unknown = [name for name in used if name not in values]
    if unknown or len(set(used)) < len(used):
        raise TrajectoryError(f'go_to: coordinates {list(used)}; allowed: each of {list(names)} once, or none for all')
    check_absent('go_to', machine, {name: values[name] for name in used})
    pose = machine.forward(start)
    for column, name in enumerate(names):
        if name not in used:
            continue
        if not np.isfinite(values[name]):
            raise TrajectoryError(f'go_to: {name} is {values[name]}; expected a finite number')
        pose[column] = values[name] + (pose[column] if relative else 0.0)
    return joints_of_pose(machine, 'go_to', pose, start)


def way_to(machine, start, target, move_time=0.0, check=None):
    """
    Return the pose trajectory of one move, straight in joint space.

    Parameters
    ----------
    machine : Machine
        Has the limits.
    start, target : ndarray, shape (n,)
        Joint positions [m].
    move_time : float
        [s]; 0: that of `Motion` by default, or the shortest that the limits allow if that is longer.
    check : callable, optional
        As for `plan`.

    Raises
    ------
    TrajectoryError, WorkspaceError
        As `plan`.

    """
    by = dict(zip(machine.joints, (target - start).tolist(), strict=True))
    motion = Motion(machine=machine.name, targets=(Target(by=by),), stay=True)
    if move_time != 0:
        check_move_time(move_time)
        motion = Motion(**{**dict(motion), 'move_time': move_time, 'limits': None})
        return plan(machine, motion, check, start)
    try:
        return plan(machine, motion, check, start)
    except TrajectoryError:
        shortest = shortest_move_time(machine, motion, start, check)
        return plan(machine, motion.model_copy(update={'move_time': shortest}), check, start)
