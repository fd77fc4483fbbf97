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


def tool_trace(trace, poses, machine):
    """Return the `ToolTrace` of a `Trace` with the planned `poses` (N, m); None if either is missing or incomplete."""
    complete = poses is not None and len(trace.error) == len(poses) and len(trace.laser_time) > 1
    if not complete or trace.laser.shape[1] != poses.shape[1]:
        return None
    time = trace.laser_time - trace.first_tick * machine.sample_time
    moved = (poses != poses[0]).any(axis=1)
    reference, measured = laser_path(time, trace.laser, poses, machine.sample_time, int(np.argmax(moved)))
    return ToolTrace(trace.cycle, time, (reference - measured) * lengths(machine.coordinates))
