"""Information of laser measurements on the lengths and marks of a machine: directions they determine, and refusals."""

import numpy as np

from pkm_core.design.budget_monte_carlo import study_poses
from pkm_core.design.specimen import LINKS, OFFSETS, error_names, sensitivities
from pkm_core.errors import PkmError

LEAST_SHARE = 0.1  # chosen: of the weakest singular value that as many poses spread over the travel have
_HIDDEN = 1e-4  # singular values below this share of the largest one belong to the unknown datum
_REFERENCE_SEED = 0  # of the poses spread over the travel


def parameter_priors(machine, tolerances):
    """Return {name: standard deviation} [m] of all estimated parameters."""
    error_names(machine)  # refuses machines without links
    mechanism = machine.config.mechanism
    return {
        **dict.fromkeys(LINKS[mechanism], tolerances.links.deviation),
        **dict.fromkeys(OFFSETS[mechanism], tolerances.offsets.deviation),
        **dict.fromkeys(machine.joints, tolerances.encoder_offsets.deviation),
    }


def fewest_poses(machine, tolerances):
    """Return the least number of poses with as many readings as unknowns; one pose is the datum."""
    return 1 + -(-len(parameter_priors(machine, tolerances)) // len(machine.coordinates))


def weighted_sensitivities(machine, q, tolerances, deviation):
    """
    Return the names of the unknowns (p,) and d end_point / d unknown (N, m, p) at the drawing.

    Unknowns are in units of their tolerance, readings in units of their standard `deviation` (m,).
    """
    priors = parameter_priors(machine, tolerances)
    S = sensitivities(machine, q, tuple(priors)) * np.array(list(priors.values()))
    return tuple(priors), S / np.asarray(deviation)[:, np.newaxis]


def weakest_direction(machine, q, tolerances, deviation):
    """
    Return (singular value, {name: part}) of the direction that poses `q` (N, n) determine least.

    Directions that only move the datum are left out; no measurement of displacements determines them.
    """
    names, rows = weighted_sensitivities(machine, q, tolerances, deviation)
    _, reference = weighted_sensitivities(
        machine, study_poses(machine, max(len(q), 4 * len(names)), _REFERENCE_SEED), tolerances, deviation
    )
    visible = _directions(reference)[1]
    _, singular, directions = np.linalg.svd(_less_datum(rows) @ visible.T, full_matrices=False)
    if len(singular) < len(visible):
        singular = np.append(singular, np.zeros(len(visible) - len(singular)))
    part = directions[-1] @ visible
    return float(singular[-1]), dict(zip(names, part.tolist(), strict=True))


def check_directions(machine, q, tolerances, deviation):
    """
    Refuse poses `q` (N, n) that are too similar: `PkmError` with the weakest direction and its singular value.

    The weakest visible direction must have LEAST_SHARE of the singular value that N poses spread over the travel give.
    """
    came, parts = weakest_direction(machine, q, tolerances, deviation)
    spread, _ = weakest_direction(machine, study_poses(machine, len(q), _REFERENCE_SEED), tolerances, deviation)
    least = LEAST_SHARE * spread
    if not came >= least > 0.0:
        mix = ' '.join(f'{part:+.2f} {name}' for name, part in parts.items() if abs(part) > 0.2)
        raise PkmError(
            f'calibration: {len(q)} poses are too similar: singular value {came:.2g} of the weakest direction {mix} '
            f'(in tolerances); allowed from {least:.2g}, {LEAST_SHARE:g} of that of poses spread over the travel'
        )


def _less_datum(rows):
    """Return `rows` (N, m, p) less their mean over the poses, as a matrix (N m, p)."""
    return (rows - rows.mean(axis=0)).reshape(-1, rows.shape[2])


def _directions(rows):
    """Return the singular values and the directions (r, p) that `rows` (N, m, p) determine at all."""
    _, singular, directions = np.linalg.svd(_less_datum(rows), full_matrices=False)
    visible = singular > _HIDDEN * singular[0]
    return singular[visible], directions[visible]
