"""Targets of a motion: their joint positions and paths, and the refusal of names and poses."""

import numpy as np

from pkm_core.errors import TrajectoryError, WorkspaceError
from pkm_core.jet import value
from pkm_core.machines.checks import ANGLES
from pkm_core.motion.paths import Arc, Line
from pkm_core.motion.reach import refuse_joints, refuse_pose


def path_of(machine, where, target, position):
    """Return the `Line` or `Arc` of a target."""
    start = machine.forward(position)
    lengths = [i for i, name in enumerate(machine.coordinates) if name not in ANGLES]
    if target.line is not None:
        return Line(start, _pose(machine, where, target.line, position)[0], lengths)
    via = target.arc.via.model_dump(exclude_none=True)
    check_absent(f'{where}: via', machine, via)
    via = {name: number for name, number in via.items() if name in machine.coordinates or number}
    _check_names(f'{where}: via', via, [machine.coordinates[i] for i in lengths], exactly=True)
    try:
        return Arc(start, np.array(list(via.values())), _pose(machine, where, target.arc.to, position)[0], lengths)
    except TrajectoryError as error:
        raise TrajectoryError(f'{where}: {error}') from None


def joints_of_path(machine, where, poses, position):
    """Return the joints (..., n) of the Jet `poses` of a path that starts at the joint `position` (n,) [m]."""
    try:
        joints = machine.inverse(poses)
        machine.check_joints(value(joints))
    except WorkspaceError:
        rows = value(poses)
        for row, pose in enumerate(rows):
            share = f'{where}: at {100 * row / max(1, len(rows) - 1):.0f} % of the path'
            joints_of_pose(machine, share, pose, position)
        raise
    return joints


def joints_of_pose(machine, where, pose, position):
    """Return the joint positions (n,) [m] at a `pose` (m,) after the joints `position` (n,) [m]."""
    try:
        joints = machine.inverse(pose)
        machine.check_joints(joints)
    except WorkspaceError as error:
        raise refuse_pose(machine, where, pose, machine.forward(position), error) from None
    return joints


def _pose(machine, where, pose, position):
    """Return the pose (m,) [m, rad] of a target and its joint positions (n,) [m], checked to be within reach."""
    given = pose.model_dump(exclude_none=True)
    check_absent(where, machine, given)
    given = {name: number for name, number in given.items() if name in machine.coordinates}
    _check_names(where, given, machine.coordinates, exactly=True)
    pose = np.array([given[name] for name in machine.coordinates])
    return pose, joints_of_pose(machine, where, pose, position)


def target_joints(machine, where, target, position):
    """Return the joint positions (n,) [m] at the end of a `pose` or `by` target reached from `position` (n,) [m]."""
    if target.pose is not None:
        return _pose(machine, where, target.pose, position)[1]
    _check_names(where, target.by, machine.joints, exactly=False)
    by = np.array([target.by.get(joint, 0.0) for joint in machine.joints])
    try:
        machine.check_joints(position + by)
        machine.forward(position + by)
    except WorkspaceError as error:
        raise refuse_joints(machine, where, position, by, error) from None
    return position + by


def check_absent(where, machine, pose):
    """Refuse a value other than 0 of a coordinate that the machine lacks."""
    for name, number in pose.items():
        if name not in machine.coordinates and number != 0:  # NaN is not 0
            unit = 'rad' if name in ANGLES else 'm'
            raise TrajectoryError(f'{where}: {name} is {number:g} {unit}; {machine.name} has no {name}, expected 0')


def _check_names(where, given, known, *, exactly):
    if not set(given) <= set(known) or (exactly and set(given) != set(known)):
        raise TrajectoryError(f'{where}: names {sorted(given)}; {"expected" if exactly else "known:"} {list(known)}')
