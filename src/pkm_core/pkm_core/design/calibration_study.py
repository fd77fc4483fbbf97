"""Calibration judged: three of four poses for the estimate, the others to judge it, and a simulation to try it on."""

from dataclasses import dataclass

import numpy as np

from pkm_core.design.budget_monte_carlo import study_poses
from pkm_core.design.calibration import Calibration, calibrate, positioning_errors, prediction_errors
from pkm_core.design.measurement import Measurements, draw_specimen, simulate
from pkm_core.errors import PkmError

FEWEST_POSES = 8  # so that two are held out


@dataclass(frozen=True)
class CalibrationStudy:
    """
    One calibration and its errors on poses that it did not use.

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
    """Return the `CalibrationStudy` of `measurements`; `PkmError` if there are too few."""
    if len(measurements.q) < FEWEST_POSES:
        raise PkmError(
            f'{len(measurements.q)} poses measured; every fourth is held out: allowed {FEWEST_POSES} or more'
        )
    used, held = measurements.split()
    noise = laser.deviation(machine, used.q)
    found = calibrate(machine, used, tolerances, noise)
    before, after = (prediction_errors(forward, held) for forward in (machine.forward, found.machine.forward))
    return CalibrationStudy(found, used, held, noise, before, after)


@dataclass(frozen=True)
class SimulatedMachine:
    """A machine of which, being simulated, the truth is known."""

    errors: dict  # {name: error} [m]
    measurements: Measurements
    test_poses: np.ndarray  # (N, m) that were not measured [m, rad]

    def sent(self, machine, inverse):
        """Return by how much it misses the test poses (N, m) [m, rad] if commanded by `inverse`."""
        return positioning_errors(machine, self.errors, inverse, self.test_poses)


def simulate_machine(machine, tolerances, laser, poses, seed):
    """Return a `SimulatedMachine` built to `tolerances` and measured at `poses` poses."""
    of_errors, of_noise, of_poses, of_tests = np.random.SeedSequence(seed).spawn(4)
    errors = draw_specimen(machine, tolerances, of_errors)
    seen = simulate(machine, errors, laser, study_poses(machine, poses, of_poses), of_noise)
    return SimulatedMachine(errors, seen, machine.forward(study_poses(machine, 500, of_tests)))
