"""Validation of a calibration on held-out poses, and a simulated machine with known errors."""

from dataclasses import dataclass

import numpy as np

from pkm_core.design.budget_monte_carlo import study_poses
from pkm_core.design.calibration import Calibration, calibrate, positioning_errors, prediction_errors
from pkm_core.design.measurement import Measurements, draw_specimen, simulate
from pkm_core.errors import PkmError

FEWEST_POSES = 8  # two of them are held out


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

    """

    calibration: Calibration
    used: Measurements
    held: Measurements
    noise: np.ndarray
    before: np.ndarray
    after: np.ndarray


def study_calibration(machine, measurements, tolerances, laser):
    """Return the `CalibrationStudy` of `measurements`; raise `PkmError` if there are fewer than FEWEST_POSES."""
    if len(measurements.q) < FEWEST_POSES:
        raise PkmError(
            f'{len(measurements.q)} poses measured, of which every fourth is held out; at least {FEWEST_POSES} are '
            f'needed'
        )
    used, held = measurements.split()
    noise = laser.deviation(machine, used.q)
    found = calibrate(machine, used, tolerances, noise)
    before, after = (prediction_errors(each.read_by_laser, held) for each in (machine, found.machine))
    return CalibrationStudy(found, used, held, noise, before, after)


@dataclass(frozen=True)
class SimulatedMachine:
    """A simulated machine with known errors."""

    errors: dict  # {name: error} [m]
    measurements: Measurements
    test_poses: np.ndarray  # (N, m) poses without a measurement [m, rad]

    def sent(self, machine, inverse):
        """Return the positioning errors (N, m) [m, rad] at the test poses, commanded by `inverse`."""
        return positioning_errors(machine, self.errors, inverse, self.test_poses)


def simulate_machine(machine, tolerances, laser, poses, seed):
    """Return a `SimulatedMachine` built to `tolerances` and measured at `poses` poses."""
    of_errors, of_noise, of_poses, of_tests = np.random.SeedSequence(seed).spawn(4)
    errors = draw_specimen(machine, tolerances, of_errors)
    seen = simulate(machine, errors, laser, study_poses(machine, poses, of_poses), of_noise)
    return SimulatedMachine(errors, seen, machine.forward(study_poses(machine, 500, of_tests)))
