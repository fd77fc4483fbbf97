"""Motion of a calibration: cycles from home through the poses and back, with a rest of stated length at each."""

from dataclasses import dataclass

import numpy as np

from pkm_core.errors import TrajectoryError, WorkspaceError
from pkm_core.motion.planning import LONGEST_CYCLE, Motion, Pose, Target, plan
from pkm_core.motion.reach import refuse_pose
from pkm_core.motion.trajectory import SampledTrajectory

MOVE_TIME = 0.2  # [s] of every move; chosen: 40 mm take 0.4 m/s and 7 m/s^2, and excite the platform by 1 um
REST = 0.15  # [s] at each pose; chosen
AVERAGED = 0.1  # [s] at the end of a rest; chosen: 125 readings of the laser, after 50 ms of settling


@dataclass(frozen=True)
class CalibrationCycle:
    """One cycle of a calibration."""

    motion: Motion  # of poses, with its move time and rests
    trajectory: SampledTrajectory  # of poses, from home to home
    poses: np.ndarray  # (k, m) [m, rad] visited in this order
    windows: np.ndarray  # (k, 2) first sample of the average of each rest, and the sample after its last one


def calibration_motion(machine, poses, *, move_time=MOVE_TIME, rest=REST, averaged=AVERAGED):
    """
    Return the `CalibrationCycle`s that visit `poses` (N, m) [m, rad] in order, as few as the longest cycle allows.

    The moves are straight in joint space, so they stay inside the travel. The return home is no pose.

    Parameters
    ----------
    machine : Machine
        Its inverse kinematics convert the poses.
    poses : array_like, shape (N, m)
        [m, rad].
    move_time, rest, averaged : float
        Of each move and each rest, and the part of the rest at its end over which readings are averaged [s].

    Raises
    ------
    TrajectoryError
        If the poses have another shape or are not finite, the average is longer than the rest, or a move is too fast.
    WorkspaceError
        If a pose is out of reach; the pose is named.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> (cycle,) = calibration_motion(planar, planar.forward(planar.home + [[1e-3, 0.0], [0.0, 2e-3]]))
    >>> cycle.windows  # [samples]: moves of 400, rests of 300 of which the last 200 count
    array([[ 540,  740],
           [1240, 1440]])

    """
    poses = _checked(machine, poses)
    if not 0.0 < averaged <= rest:
        raise TrajectoryError(f'calibration: average over {averaged:g} s; allowed up to the rest, {rest:g} s')
    lead = Motion.model_fields['lead_rest'].default
    if not rest > lead:
        raise TrajectoryError(f'calibration: rest of {rest:g} s; allowed above {lead:g} s')
    most = int((LONGEST_CYCLE + 1e-9) / (move_time + rest)) - 1  # the last move returns home
    if most < 1:
        raise TrajectoryError(
            f'calibration: a move of {move_time:g} s and a rest of {rest:g} s; allowed {LONGEST_CYCLE / 2:g} s together'
        )
    parts = np.array_split(poses, -(-len(poses) // most))
    return tuple(_cycle(machine, part, move_time, lead, rest, averaged) for part in parts)


def _cycle(machine, poses, move_time, lead, rest, averaged):
    targets = tuple(Target(pose=Pose(**dict(zip(machine.coordinates, row, strict=True)))) for row in poses.tolist())
    motion = Motion(
        machine=machine.name, targets=targets, move_time=move_time, lead_rest=lead, settle_window=rest - lead
    )
    trajectory = plan(machine, motion)
    windows = windows_of_moves(trajectory.move_starts, trajectory.move_ends, averaged / trajectory.sample_time)
    return CalibrationCycle(motion, trajectory, poses, windows)


def windows_of_moves(move_starts, move_ends, averaged):
    """
    Return the windows (k, 2) [samples] of the rests between moves, one per move but the last.

    A window ends where the next move starts and holds the last `averaged` [samples] before it, or the whole rest if
    that is shorter.
    """
    ends = np.asarray(move_starts)[1:]
    return np.stack([np.maximum(np.asarray(move_ends)[:-1], ends - round(averaged)), ends], axis=1)


def _checked(machine, poses):
    poses = np.asarray(poses, dtype=float)
    if poses.ndim != 2 or poses.shape[0] == 0 or poses.shape[1] != len(machine.coordinates):
        raise TrajectoryError(f'calibration: poses of shape {poses.shape}; expected (N, {len(machine.coordinates)})')
    for number, pose in enumerate(poses):
        try:
            machine.check_pose(pose)
        except WorkspaceError as error:
            home = machine.forward(machine.home)
            raise refuse_pose(machine, f'calibration: pose {number}', pose, home, error) from None
    return poses
