"""
Kinematic calibration: from laser measurements the lengths and marks of one built machine, and how well they are known.

The estimate is the most probable one given the measurements and the tolerances the machine was built to: a nonlinear
least-squares problem in all errors of links, offsets and encoders, each in units of its tolerance. The laser's axes are
those of the machine, its datum is unknown and drops out with the mean over the poses. What the measurements cannot tell
stays where the drawing has it. A machine that was calibrated before starts from its drawing again.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.design.specimen import LINKS, OFFSETS, end_point, error_names, sensitivities
from pkm_core.errors import PkmError


def built_machine(machine, errors):
    """Return `machine` with section `built` of its file filled: lengths and marks off the drawing by `errors` [m]."""
    config = machine.config
    drawn = type(machine).Built.as_drawn(config.geometry)
    marks = drawn.marks.model_copy(update={joint: errors.get(joint, 0.0) for joint in machine.joints})
    off = {name: value + errors.get(name, 0.0) for name, value in drawn if name != 'marks'}
    built = drawn.model_copy(update={**off, 'marks': marks})
    return type(machine)(config.model_copy(update={'built': built}), machine.name, machine.configuration)


class Identifiability(NamedTuple):
    """What the measurements can tell, to first order at the drawing."""

    names: tuple[str, ...]
    singular_values: np.ndarray  # (p,): how many times better than the tolerances a direction is known; below 1 hardly
    directions: np.ndarray  # (p, p): row i is the direction of singular value i, in units of the tolerances

    def hardly_known(self, share=0.3):
        """Return [(singular value, {name: part})] of the directions below 1, parts above `share` only."""
        return [
            (float(value), {name: float(part) for name, part in zip(self.names, row, strict=True) if abs(part) > share})
            for value, row in zip(self.singular_values, self.directions, strict=True)
            if value < 1.0
        ]


class Calibration(NamedTuple):
    """The outcome for one machine."""

    machine: object  # the `Machine` as it was built; forward and inverse take its lengths and marks
    errors: dict  # {name: deviation from the drawing} as in specimen.py [m]
    deviations: dict  # {name: standard deviation of the estimate} [m]
    priors: dict  # {name: standard deviation before, from the tolerances} [m]
    identifiability: Identifiability
    misfit: float  # root mean square of the residuals over the measurement's deviation; about 1 if the model holds


def parameter_priors(machine, tolerances):
    """Return {name: standard deviation} [m] of all that is estimated."""
    error_names(machine)  # refuses machines without links
    mechanism = machine.config.mechanism
    return {
        **dict.fromkeys(LINKS[mechanism], tolerances.links.deviation),
        **dict.fromkeys(OFFSETS[mechanism], tolerances.offsets.deviation),
        **dict.fromkeys(machine.joints, tolerances.encoder_offsets.deviation),
    }


def calibrate(machine, measurements, tolerances, deviation):
    """
    Return the `Calibration` of `machine` from `measurements`, which have the standard `deviation` (m,).

    Raises
    ------
    PkmError
        If there are too few poses, something is not finite, or a tolerance is zero.
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

    priors = parameter_priors(machine, tolerances)
    names, prior = tuple(priors), np.array(list(priors.values()))
    _check(machine, measurements, priors)

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
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    _, singular, directions = np.linalg.svd(slope(np.zeros(len(names)))[: -len(names)], full_matrices=False)
    poses, coordinates = measurements.displacement.shape
    errors = {name: float(error) for name, error in model(found.x).items()}
    return Calibration(
        built_machine(machine, errors),
        errors,
        dict(zip(names, (prior * np.sqrt(np.diag(covariance))).tolist(), strict=True)),
        priors,
        Identifiability(names, singular, directions),
        float(np.sqrt(np.sum(found.fun[: -len(names)] ** 2) / ((poses - 1) * coordinates))),
    )


def _weighted(values, deviation):
    """Return `values` (N, m, ...) without their mean over the poses, which the datum hides, over `deviation`."""
    return (values - values.mean(axis=0)) / deviation


def _check(machine, measurements, priors):
    machine.check_joints(measurements.q)
    poses, coordinates = measurements.displacement.shape
    if not np.isfinite(measurements.displacement).all():
        raise PkmError('measurements: a displacement is not finite')
    fewest = 1 + -(-len(priors) // coordinates)
    if poses < fewest:
        raise PkmError(f'{poses} poses measured; {len(priors)} unknowns ask for at least {fewest}')
    for name, deviation in priors.items():
        if not deviation > 0.0:
            raise PkmError(f'tolerances: {name} has the deviation {deviation:g} m; allowed above 0 for calibration')


def prediction_errors(forward, measurements):
    """Return measured minus predicted displacement (N, m) [m, rad] of `forward`, without what the datum hides."""
    difference = measurements.displacement - forward(measurements.q)
    return difference - difference.mean(axis=0)


def positioning_errors(machine, errors, inverse, poses):
    """
    Return where a specimen with `errors` goes minus where it was sent (N, m) [m, rad], without what the datum hides.

    `inverse` turns the wanted `poses` (N, m) into commanded joint positions. Only a simulation knows the `errors`.
    """
    reached = end_point(machine, inverse(poses), errors) - poses
    return reached - reached.mean(axis=0)
