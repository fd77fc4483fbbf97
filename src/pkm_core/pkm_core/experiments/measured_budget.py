"""
Error budget against simulated machines: the deviations that `pkm budget` predicts beside those of built specimens.

Each specimen is sent to poses by the drawing, calibrated from encoders and laser, and sent there again. The truth of
the plant judges both. Errors are less their mean over the poses, which is a shift of the datum.
"""

import numpy as np

from pkm_core.design.budget import deviation_from_datum, linear_budget, sources
from pkm_core.design.geometry import geometry_names
from pkm_core.design.measurement import load_laser
from pkm_core.design.pose_plan import plan_poses, spread_poses
from pkm_core.design.specimen import sensitivities
from pkm_core.design.tolerances import Tolerances
from pkm_core.experiments.simulated_calibration import simulate_calibration
from pkm_core.machines import load_machine
from pkm_core.simulation.true_rests import true_errors

POSES, OTHERS = 20, 50  # of the calibration, and of the judge
_BUILT = ('link lengths', 'encoder offsets')  # sources that every specimen has; its offsets are those of the drawing
_GEOMETRY = ('scales', 'straightness', 'squareness and height')
_PLAN_SEED, _OTHER_SEED = 1, 2


def measured_tasks(machine_name, tolerances, environment, specimens):
    """Return the tasks (function, arguments ...) of seeds 1 to `specimens`, for `farm`."""
    given = tolerances.model_dump()  # numbers, because the model cannot be sent to another process
    return [(specimen_figures, machine_name, given, environment, seed) for seed in range(1, specimens + 1)]


def specimen_figures(machine_name, tolerances, environment, seed):
    """
    Return the figures of one specimen, {name: (m,)} [m, rad]; `tolerances` is the dict of a `Tolerances`.

    'drawing', 'calibrated': root mean square errors at the other poses. 'covariance': deviation of the calibrated
    machine that follows from the covariance of its calibration. 'axes': deviation due to the error of the encoders and
    to axes that rest beside their reference, as the encoders show in the calibration.
    """
    machine, laser, tolerances = load_machine(machine_name).drawing, load_laser(), Tolerances(**tolerances)
    plan = plan_poses(machine, POSES, _PLAN_SEED, tolerances, laser)
    done = simulate_calibration(machine, seed, environment, plan, others=OTHERS, tolerances=tolerances, laser=laser)
    found = done.calibration.machine
    q = found.inverse(_others(machine))
    resting = np.mean((done.measurements.q - machine.inverse(plan)) ** 2, axis=0)
    axes = np.mean(found.jacobian(q) ** 2, axis=0) @ (resting + laser.encoder_error**2)
    return {
        'covariance': _of_covariance(found, q),
        'axes': np.sqrt(axes),
        'drawing': _mean_square(done.before),
        'calibrated': _mean_square(done.after),
    }


def _others(machine):
    """Return poses (OTHERS, m) like those of the judge."""
    return spread_poses(machine, OTHERS, _OTHER_SEED)


def _of_covariance(machine, q):
    """Return the deviation (m,) of the calibrated `machine` at `q` (N, n), less that of the mean over the poses."""
    known = machine.config.built.uncertainty
    D = sensitivities(machine, q, tuple(known.deviations))
    D = D - D.mean(axis=0)
    return np.sqrt(np.mean(np.einsum('pij,jk,pik->pi', D, known.covariance, D), axis=0))


def measured_rows(machine_name, tolerances, environment, results):
    """
    Return {what: deviation (m,)} [m, rad] of predictions and of the `results` of `measured_tasks`.

    Predictions for the drawing include the sources that specimens of the environment have. The first row has all
    sources and the shift of the datum, as `pkm budget` prints.
    """
    machine = load_machine(machine_name).drawing
    q = machine.inverse(_others(machine))
    geometry = not set(geometry_names(machine)).isdisjoint(true_errors(machine, 1, environment))
    groups = _BUILT + (_GEOMETRY if geometry else ())
    built = [source for source in sources(machine, tolerances, q, geometry) if source.group in groups]
    total = linear_budget(machine, tolerances, q, geometry).total()
    drawing, calibrated, covariance, axes = (
        np.array([each[name] for each in results]) for name in ('drawing', 'calibrated', 'covariance', 'axes')
    )
    return {
        'predicted from all tolerances, with the datum': _mean_square(total),
        'drawing, predicted': deviation_from_datum(machine, built, q),
        'drawing, measured': _mean_square(drawing),
        'drawing, measured, worst specimen': drawing.max(axis=0),
        'calibrated, predicted from the covariance': _mean_square(covariance),
        'calibrated, predicted with the rest of the axes': np.hypot(_mean_square(covariance), _mean_square(axes)),
        'calibrated, measured': _mean_square(calibrated),
        'calibrated, measured, worst specimen': calibrated.max(axis=0),
    }


def _mean_square(deviations):
    return np.sqrt(np.mean(deviations**2, axis=0))
