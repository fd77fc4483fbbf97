"""
Kinematic calibration: lengths and marks of one built machine from laser measurements, with their uncertainty.

The estimate is the most probable one given the measurements and the manufacturing tolerances. It is a nonlinear
least-squares problem in all errors of links, offsets and encoders, each scaled by its tolerance. The laser's axes are
those of the machine; its datum is unknown and removed with the mean over the poses. Parameters that the measurements
do not determine keep their drawing values. A repeated calibration starts from the drawing.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.design.calibration_fit import fit
from pkm_core.design.geometry import built_geometry, geometry_priors
from pkm_core.design.information import check_directions, fewest_poses, parameter_priors
from pkm_core.design.specimen import end_point
from pkm_core.design.units import units
from pkm_core.errors import PkmError
from pkm_core.machines.uncertainty import Uncertainty

LARGEST_MISFIT = 1.5  # chosen: 80 residuals of a valid model exceed 1.3 once in a million calibrations
GEOMETRIES = ('auto', 'lengths', 'full')  # sets of unknowns, see `calibrate`
_WORST = 3  # poses named in a refusal


def built_machine(machine, errors, specimen=None, uncertainty=None):
    """Return `machine` with a section `built`: lengths and marks of the drawing plus `errors` [m], of `specimen`."""
    config = machine.config
    drawn = type(machine).Built.as_drawn(config.geometry)
    marks = drawn.marks.model_copy(update={joint: errors.get(joint, 0.0) for joint in machine.joints})
    off = {name: value + errors.get(name, 0.0) for name, value in drawn.lengths().items()}
    sections = {'specimen': specimen, 'uncertainty': uncertainty, 'geometry': built_geometry(machine, errors)}
    built = drawn.model_copy(update={**off, 'marks': marks, **sections})
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


def calibrate(machine, measurements, tolerances, deviation, largest_misfit=LARGEST_MISFIT, geometry='auto'):
    """
    Return the `Calibration` of `machine` from `measurements`, which have the standard `deviation` (m,).

    `geometry` is the set of unknowns: 'lengths' (with offsets and marks), 'full' (with guides, scales and axes of the
    laser), or 'auto', the one of both under which the measurements are more probable.

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
    machine = machine.drawing
    lengths = parameter_priors(machine, tolerances)
    _check(machine, measurements, tolerances, lengths)
    check_directions(machine, measurements.q, tolerances, deviation)
    found = max(_fits(machine, measurements, tolerances, deviation, geometry), key=lambda each: each.log_evidence)
    if not found.misfit <= largest_misfit:
        raise PkmError(
            f'calibration: misfit {found.misfit:.2f} of the noise; allowed {largest_misfit:g}; '
            f'{_pattern(machine, found.residuals, deviation)}'
        )
    _, singular, directions = np.linalg.svd(found.slope_at_drawing, full_matrices=False)
    return Calibration(
        built_machine(
            machine, found.errors, measurements.specimen, Uncertainty.of(tuple(found.priors), found.covariance)
        ),
        found.errors,
        found.deviations,
        found.priors,
        Identifiability(tuple(found.priors), singular, directions),
        found.misfit,
    )


def _fits(machine, measurements, tolerances, deviation, geometry):
    """Return the fits of the sets of unknowns that `geometry` allows."""
    if geometry not in GEOMETRIES:
        raise PkmError(f'calibration: geometry: {geometry!r} given; allowed: {", ".join(GEOMETRIES)}')
    lengths = parameter_priors(machine, tolerances)
    sets = [] if geometry == 'full' else [lengths]
    if geometry == 'full' or (geometry == 'auto' and tolerances.geometry is not None):
        sets.append(lengths | geometry_priors(machine, tolerances))
    return [fit(machine, measurements, priors, deviation) for priors in sets]


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


def prediction_errors(predict, measurements):
    """
    Return measured minus predicted displacement (N, m) [m, rad], less the mean over the poses.

    `predict` maps readings (N, n) to poses (N, m), e.g. `Machine.read_by_laser`.
    """
    difference = measurements.displacement - predict(measurements.q)
    return difference - difference.mean(axis=0)


def positioning_errors(machine, errors, inverse, poses):
    """
    Return reached minus commanded poses (N, m) [m, rad] of a specimen with `errors`, less the mean over the poses.

    `inverse` maps the commanded `poses` (N, m) to joint positions. The `errors` are known only in simulation.
    """
    reached = end_point(machine, inverse(poses), errors) - poses
    return reached - reached.mean(axis=0)
