"""A calibration and its validation on held-out poses: the command `pkm calibrate`."""

from dataclasses import dataclass

import numpy as np

from pkm_core.design.calibration import Calibration, calibrate, prediction_errors
from pkm_core.design.measurement import Measurements
from pkm_core.design.pose_plan import plan_poses, spread_poses
from pkm_core.design.verification import Verification, verify
from pkm_core.errors import PkmError

FEWEST_POSES = 16  # every fourth is held out; four of those verify
HELD = 4  # every HELD-th pose is held out


@dataclass(frozen=True)
class CalibrationStudy:
    """
    One calibration and its errors on held-out poses.

    Attributes
    ----------
    calibration : Calibration
    used, held : Measurements
    noise : ndarray, shape (m,)
        Standard deviation of a measurement [m, rad].
    before, after : ndarray, shape (held out, m)
        Measured minus predicted displacement, by the drawing and by the calibrated model [m, rad].
    verification : Verification
        Whether the calibrated model is better.

    """

    calibration: Calibration
    used: Measurements
    held: Measurements
    noise: np.ndarray
    before: np.ndarray
    after: np.ndarray
    verification: Verification


def study_calibration(machine, measurements, tolerances, laser):
    """Return the `CalibrationStudy` of `measurements`; raise `PkmError` if there are fewer than FEWEST_POSES."""
    if len(measurements.q) < FEWEST_POSES:
        raise PkmError(
            f'{len(measurements.q)} poses measured, of which every fourth is held out; at least {FEWEST_POSES} are '
            f'needed'
        )
    used, held = measurements.split(HELD)
    noise = used.noise(machine, laser)
    found = calibrate(machine, used, tolerances, noise)
    before, after = (prediction_errors(forward, held) for forward in (machine.forward, found.machine.forward))
    verification = verify(machine, found.machine, held, noise)
    return CalibrationStudy(found, used, held, noise, before, after, verification)


def study_plan(machine, count, seed, tolerances, laser):
    """
    Return `count` poses (N, m) [m, rad] for `study_calibration`.

    The poses that are used are a D-optimal plan; those held out are spread over the travel.
    """
    held = np.arange(count) % HELD == HELD - 1
    poses = np.empty((count, len(machine.coordinates)))
    poses[~held] = plan_poses(machine, int(np.sum(~held)), seed, tolerances, laser)
    if held.any():
        poses[held] = spread_poses(machine, int(np.sum(held)), seed)
    return poses
