"""
A whole calibration in simulation, without ROS: measured, calibrated, and judged by the truth at other poses.

The calibration reads encoders and laser only. The judge alone reads the truth.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.design.calibration import Calibration, calibrate
from pkm_core.design.calibration_study import study_plan
from pkm_core.design.measurement import Measurements, load_laser
from pkm_core.design.pose_plan import plan_poses, spread_poses
from pkm_core.design.tolerances import load_tolerances
from pkm_core.machines.checks import ANGLES
from pkm_core.simulation.calibration import measure_poses
from pkm_core.simulation.true_rests import true_errors, true_poses, true_rests

POSES, OTHERS = 20, 50  # of the calibration, and of the judge
_PLAN_SEED, _OTHER_SEED = 1, 2  # one plan for all specimens, as a user would have


@dataclass(frozen=True)
class SimulatedCalibration:
    """A calibration of the simulated machine, and its errors of rest at other poses by the truth, less their mean."""

    measurements: Measurements
    calibration: Calibration
    before: np.ndarray  # (others, m) [m, rad] reached minus commanded pose, sent by the drawing
    after: np.ndarray  # (others, m) sent by the calibrated machine


def simulate_calibration(
    machine, seed, environment='nominal', poses=POSES, *, others=OTHERS, tolerances=None, laser=None
):
    """
    Return the `SimulatedCalibration` of the machine of `seed` and `environment`.

    Parameters
    ----------
    machine : Machine
        The drawing.
    seed, environment : int, str
        Of the plant: specimen and noise.
    poses : int or ndarray, shape (N, m)
        Number of poses of a D-optimal plan, or the poses [m, rad].
    others : int
        Number of other poses of the judge, spread over the travel.
    tolerances, laser : Tolerances, LaserConfig
        By default those of the configuration.

    Raises
    ------
    PkmError
        If the poses or the calibration are refused, or the machine stops with a fault.

    """
    tolerances, laser = tolerances or load_tolerances(), laser or load_laser()
    plan = plan_poses(machine, poses, _PLAN_SEED, tolerances, laser) if np.ndim(poses) == 0 else np.asarray(poses)
    seen = measure_poses(machine, plan, laser, seed, environment)
    found = calibrate(machine, seen, tolerances, seen.deviation)
    wanted = spread_poses(machine, others, _OTHER_SEED)
    before, after = (
        _less_mean(true_rests(each, wanted, seed, environment) - wanted) for each in (machine, found.machine)
    )
    return SimulatedCalibration(seen, found, before, after)


def measure_study(machine, count, tolerances, laser, seed, environment):
    """Return the `Measurements` of the poses of `study_plan` on the simulated machine."""
    plan = study_plan(machine, count, _PLAN_SEED, tolerances, laser)
    return measure_poses(machine, plan, laser, seed, environment)


class TrueSpecimen:
    """The simulated machine of `seed` and `environment` as the judge of a calibration."""

    def __init__(self, machine, seed, environment):
        self._machine, self._built = machine, (seed, environment)
        self.errors = true_errors(machine, seed, environment)  # {name: error} [m]

    def sent(self, inverse, others=500):
        """
        Return reached minus commanded poses (others, m) [m, rad], less their mean, at poses spread over the travel.

        `inverse` maps the commanded poses to encoder readings; controllers and encoders are without error.
        """
        wanted = spread_poses(self._machine, others, _OTHER_SEED)
        return _less_mean(true_poses(self._machine, inverse(wanted), *self._built) - wanted)


def _less_mean(errors):
    """Return `errors` (N, m) less their mean over the poses: a laser from a datum cannot measure it."""
    return errors - errors.mean(axis=0)


def rest_figures(machine_name, environment, seed, poses=POSES):
    """Return {'before', 'after', 'largest'} errors (m,) [m; phi on the arm of the laser] and 'misfit' of one run."""
    from pkm_core.machines import load_machine

    machine, laser = load_machine(machine_name), load_laser()
    done = simulate_calibration(machine, seed, environment, poses)
    arm = np.array([laser.rotation_arm if name in ANGLES else 1.0 for name in machine.coordinates])
    before, after = done.before * arm, done.after * arm
    return {
        'before': np.sqrt(np.mean(before**2, axis=0)),
        'after': np.sqrt(np.mean(after**2, axis=0)),
        'largest': np.abs(after).max(axis=0),
        'misfit': done.calibration.misfit,
    }
