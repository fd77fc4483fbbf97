"""Error of the tool over one cycle by laser, against the planned poses."""

from dataclasses import dataclass

import numpy as np

from pkm_core.reporting.histories import laser_path, lengths


@dataclass(frozen=True, eq=False)
class ToolTrace:
    """One cycle; one row per sample of the laser, one column per coordinate."""

    cycle: int
    time: np.ndarray  # (K,) since the start of the cycle [s]
    error: np.ndarray  # (K, m) [m], rotations on `pkm_core.reporting.histories.ARM`


def tool_trace(cycle, time, displacement, poses, machine):
    """
    Return the `ToolTrace` of one cycle, None without a laser or a plan.

    Parameters
    ----------
    cycle : int
        Its number.
    time, displacement : ndarray, shape (K,), (K, m)
        Samples of the laser: since the start of the cycle [s]; [m, rad].
    poses : ndarray, shape (N, m), or None
        Planned poses at the ticks [m, rad].
    machine : pkm_core.machines.base.Machine
        For its sample time and coordinates.

    """
    if poses is None or len(time) < 2 or displacement.shape[1:] != poses.shape[1:]:
        return None
    moved = (poses != poses[0]).any(axis=1)
    first_move = int(np.argmax(moved)) if moved.any() else len(poses)
    reference, measured = laser_path(time, displacement, poses, machine.sample_time, first_move)
    return ToolTrace(cycle, time, (reference - measured) * lengths(machine.coordinates))
