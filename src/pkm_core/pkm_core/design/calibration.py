"""
Kinematic calibration: lengths and marks of one built machine from laser measurements, with their uncertainty.

The estimate is the most probable one given the measurements and the manufacturing tolerances. It is a nonlinear
least-squares problem in all errors of links, offsets and encoders, each scaled by its tolerance. The laser's axes are
those of the machine; its datum is unknown and removed with the mean over the poses. Parameters that the measurements
do not determine keep their drawing values. A repeated calibration starts from the drawing.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.design.information import check_directions, fewest_poses, parameter_priors
from pkm_core.design.specimen import end_point, sensitivities
from pkm_core.design.units import units
from pkm_core.errors import PkmError
from pkm_core.machines.uncertainty import Uncertainty

LARGEST_MISFIT = 1.5  # chosen: 80 residuals of a valid model exceed 1.3 once in a million calibrations
_WORST = 3  # poses named in a refusal


def built_machine(machine, errors, specimen=None, uncertainty=None):
    """Return `machine` with a section `built`: lengths and marks of the drawing plus `errors` [m], of `specimen`."""
    config = machine.config
    drawn = type(machine).Built.as_drawn(config.geometry)
    marks = drawn.marks.model_copy(update={joint: errors.get(joint, 0.0) for joint in machine.joints})
    off = {name: value + errors.get(name, 0.0) for name, value in drawn.lengths().items()}
    built = drawn.model_copy(update={**off, 'marks': marks, 'specimen': specimen, 'uncertainty': uncertainty})
    return type(machine)(config.model_copy(update={'built': built}), machine.name, machine.configuration)


class Identifiability(NamedTuple):
    """Information of the measurements, to first order at the drawing."""

    names: tuple[str, ...]
    singular_values: np.ndarray  # (p,): tolerance over uncertainty from the measurements alone, by direction
    directions: np.ndarray  # (p, p): row i is the direction of singular value i, in units of the tolerances

    def hardly_known(self, share=0.3):
        """Return [(singular value, {name: part})] of the directions below 1, with the parts above `share`."""
        return [
            (float(value), {name: float(part) for name, part in zip(self.names, row, strict=True) if abs(part) > share})
            for value, row in zip(self.singular_values, self.directions, strict=True)
            if value < 1.0
        ]


class Calibration(NamedTuple):
    """Calibration of one machine."""

    machine: object  # the calibrated `Machine`; its forward and inverse use the estimated lengths and marks
    errors: dict  # {name: deviation from the drawing} as in specimen.py [m]
    deviations: dict  # {name: standard deviation of the estimate} [m]
    priors: dict  # {name: standard deviation before, from the tolerances} [m]
    identifiability: Identifiability
    misfit: float  # root mean square of the residuals over the measurement's deviation; about 1 for a valid model


def calibrate(machine, measurements, tolerances, deviation, largest_misfit=LARGEST_MISFIT):
    """
    Return the `Calibration` of `machine` from `measurements`, which have the standard `deviation` (m,).

    A calibration with a misfit above `largest_misfit` is refused: the machine has errors outside this model, or the
    measurements are disturbed. The refusal has the pattern of the residuals: coordinates and worst poses.

    Raises
    ------
    PkmError
        If there are too few or too similar poses, something is not finite, a tolerance is zero, or the misfit is too
        large.
    WorkspaceError
        If a reading is outside the travel.

    Examples
    --------
    >>> from pkm_core.design.budget_monte_carlo import study_poses
    >>> from pkm_core.design.measurement import load_laser, simulate
    >>> from pkm_core.design.tolerances import load_tolerances
    >>> from pkm_core.machines import load_machine
    >>> planar, laser = load_machine('planar'), load_laser()
    >>> q = study_poses(planar, 100, seed=1)
    >>> seen = simulate(planar, {'l2': 20e-6, 'l4': -10e-6}, laser, q, seed=1)
    >>> found = calibrate(planar, seen, load_tolerances(), laser.deviation(planar, q))
    >>> {name: round(1e6 * found.errors[name]) for name in ('l2', 'l4')}  # um
    {'l2': 19, 'l4': -11}

    """
    from scipy.optimize import least_squares

    machine = machine.drawing
    priors = parameter_priors(machine, tolerances)
    names, prior = tuple(priors), np.array(list(priors.values()))
    _check(machine, measurements, tolerances, priors)
    check_directions(machine, measurements.q, tolerances, deviation)

    def model(scaled):
        return dict(zip(names, prior * scaled, strict=True))

    def residuals(scaled):
        predicted = end_point(machine, measurements.q, model(scaled))
        return np.concatenate([_weighted(predicted - measurements.displacement, deviation).ravel(), scaled])

    def slope(scaled):
        S = sensitivities(machine, measurements.q, names, model(scaled))
        data = _weighted(S, np.asarray(deviation)[:, np.newaxis]).reshape(-1, len(names)) * prior
        return np.vstack([data, np.eye(len(names))])

    found = least_squares(residuals, np.zeros(len(names)), slope, x_scale=1.0, xtol=1e-12, ftol=1e-12, gtol=1e-10)
    covariance = np.linalg.inv(found.jac.T @ found.jac) * np.outer(prior, prior)
    _, singular, directions = np.linalg.svd(slope(np.zeros(len(names)))[: -len(names)], full_matrices=False)
    poses, coordinates = measurements.displacement.shape
    errors = {name: float(error) for name, error in model(found.x).items()}
    misfit = float(np.sqrt(np.sum(found.fun[: -len(names)] ** 2) / ((poses - 1) * coordinates)))
    if not misfit <= largest_misfit:
        rows = found.fun[: -len(names)].reshape(poses, coordinates)
        raise PkmError(
            f'calibration: misfit {misfit:.2f} of the noise; allowed {largest_misfit:g}; '
            f'{_pattern(machine, rows, deviation)}'
        )
    return Calibration(
        built_machine(machine, errors, measurements.specimen, Uncertainty.of(names, covariance)),
        errors,
        dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        priors,
        Identifiability(names, singular, directions),
        misfit,
    )


def _pattern(machine, residuals, deviation):
    """Return the pattern of `residuals` (N, m), in deviations, as a text: their size by coordinate, the worst poses."""
    sizes = np.sqrt(np.mean(residuals**2, axis=0))
    by_coordinate = ', '.join(f'{name} {size:.1f}' for name, size in zip(machine.coordinates, sizes, strict=True))
    worst = np.argsort(-np.abs(residuals).max(axis=1), kind='stable')[:_WORST]
    named = []
    for pose in worst:
        at = int(np.argmax(np.abs(residuals[pose])))
        factor, unit = units(machine)[at]
        named.append(
            f'pose {pose} {machine.coordinates[at]} {factor * residuals[pose, at] * deviation[at]:+.2f} {unit}'
        )
    return f'residuals over the noise: {by_coordinate}; largest: {", ".join(named)}'


def _weighted(values, deviation):
    """Return `values` (N, m, ...) less their mean over the poses (the unknown datum), over `deviation`."""
    return (values - values.mean(axis=0)) / deviation


def _check(machine, measurements, tolerances, priors):
    machine.check_joints(measurements.q)
    poses = len(measurements.displacement)
    if not np.isfinite(measurements.displacement).all():
        raise PkmError('measurements: a displacement is not finite')
    fewest = fewest_poses(machine, tolerances)
    if poses < fewest:
        raise PkmError(f'{poses} poses measured; {len(priors)} unknowns need at least {fewest}')
    for name, deviation in priors.items():
        if not deviation > 0.0:
            raise PkmError(f'tolerances: the deviation of {name} is {deviation:g} m; allowed above 0 for calibration')


def prediction_errors(forward, measurements):
    """Return measured minus predicted displacement (N, m) [m, rad] of `forward`, less the mean over the poses."""
    difference = measurements.displacement - forward(measurements.q)
    return difference - difference.mean(axis=0)


def positioning_errors(machine, errors, inverse, poses):
    """
    Return reached minus commanded poses (N, m) [m, rad] of a specimen with `errors`, less the mean over the poses.

    `inverse` maps the commanded `poses` (N, m) to joint positions. The `errors` are known only in simulation.
    """
    reached = end_point(machine, inverse(poses), errors) - poses
    return reached - reached.mean(axis=0)
