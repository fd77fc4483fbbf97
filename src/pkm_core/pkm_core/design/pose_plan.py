"""
Choice of the poses of a calibration: a D-optimal plan inside the travel.

A plan maximises the determinant of the information on all lengths and marks, each in units of its tolerance, with the
unknown datum of the laser as further unknowns: the greatest reduction of the volume of uncertainty. Candidates are
evenly spread joint positions, the corners of the travel and the centres of its faces, all `MARGIN` of the travel inside
(2.4). A greedy start is improved by Fedorov's exchange: the pose that leaves and the one that replaces it are chosen
together, until no exchange gains. A pose is used once, because repeated readings of a laser share their rounding.
Source: Fedorov, Theory of Optimal Experiments (1972), ch. 3.
"""

import itertools

import numpy as np

from pkm_core.design.budget_monte_carlo import study_poses
from pkm_core.design.information import check_directions, fewest_poses, weighted_sensitivities
from pkm_core.errors import PkmError

MARGIN = 0.02  # of the travel at each end; chosen: 0.8 mm, far above the overshoot of a slow move
CANDIDATES = 400  # spread over the travel, beside its corners and faces
MOST_POSES = 200
_SWEEPS = 20  # of exchanges; ten suffice for 60 poses
_DATUM = 1e-9  # information on the datum before the first pose; regularises the start only


def plan_poses(machine, count, seed, tolerances, laser):
    """
    Return the poses (count, m) [m, rad] of a calibration, in the order of a short tour from home.

    Parameters
    ----------
    machine : Machine
        With its drawing or an earlier calibration; the plan is that of the drawing.
    count : int
        Number of poses.
    seed : int
        Of the candidates; the same seed gives the same bits.
    tolerances : Tolerances
        Spreads of the lengths before the calibration.
    laser : LaserConfig
        Accuracy of the measurement.

    Raises
    ------
    PkmError
        If `count` is below the fewest poses that determine all unknowns, or above MOST_POSES; or if no choice of poses
        in this travel determines a direction well enough: the weakest direction is named.

    Examples
    --------
    >>> from pkm_core.design.measurement import load_laser
    >>> from pkm_core.design.tolerances import load_tolerances
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> plan_poses(planar, 20, 1, load_tolerances(), load_laser()).shape
    (20, 2)

    """
    drawing = machine.drawing
    fewest = fewest_poses(drawing, tolerances)
    if not fewest <= count <= MOST_POSES:
        raise PkmError(f'calibration: {count} poses given; allowed {fewest} to {MOST_POSES} for {machine.name}')
    q = _candidates(drawing, seed)
    deviation = laser.deviation(drawing, q)
    names, rows = weighted_sensitivities(drawing, q, tolerances, deviation)
    datum = np.broadcast_to(np.eye(rows.shape[1]), (len(q), rows.shape[1], rows.shape[1]))
    chosen = _exchange(
        np.concatenate([rows, datum], axis=2), count, np.array([1.0] * len(names) + [_DATUM] * len(datum[0]))
    )
    check_directions(drawing, q[chosen], tolerances, deviation)
    return drawing.forward(_tour(drawing, q[chosen]))


def spread_poses(machine, count, seed):
    """Return poses (count, m) [m, rad] spread evenly over the travel, MARGIN inside; for a verification."""
    return machine.drawing.forward(_tour(machine, _inside(machine, study_poses(machine, count, seed))))


def _inside(machine, q):
    """Return `q` (N, n) drawn towards the centre of the travel, so that it lies MARGIN inside."""
    centre = 0.5 * (machine.limits.lower + machine.limits.upper)
    return centre + (1.0 - 2.0 * MARGIN) * (q - centre)


def _candidates(machine, seed):
    """Return the joint positions (N, n) [m] from which the poses are chosen."""
    ends = np.stack([machine.limits.lower, machine.limits.upper])
    n = len(machine.joints)
    corners = np.array([[ends[end, i] for i, end in enumerate(picks)] for picks in itertools.product((0, 1), repeat=n)])
    faces = np.tile(ends.mean(axis=0), (2 * n, 1))
    for i in range(n):
        faces[2 * i : 2 * i + 2, i] = ends[:, i]
    return _inside(machine, np.concatenate([study_poses(machine, CANDIDATES, seed), corners, faces]))


def _exchange(rows, count, prior):
    """Return the indices (count,) of the D-optimal choice among the candidates `rows` (N, m, p); `prior` is (p,)."""
    information = np.diag(prior)
    free = np.ones(len(rows), dtype=bool)
    chosen = []
    for _ in range(count):
        best = int(np.argmax(np.where(free, _gains(rows, information), -np.inf)))
        chosen.append(best)
        free[best] = False
        information = information + rows[best].T @ rows[best]
    for _ in range(_SWEEPS):
        swapped = False
        for place, old in enumerate(chosen):
            without = information - rows[old].T @ rows[old]
            gains = np.where(free, _gains(rows, without), -np.inf)
            gain_of_old = _gains(rows[old : old + 1], without)[0]
            best = int(np.argmax(gains))
            if gains[best] > gain_of_old + 1e-9:  # rounding does not exchange equal poses
                chosen[place], free[old], free[best], swapped = best, True, False, True
                information = without + rows[best].T @ rows[best]
        if not swapped:
            break
    return np.array(chosen)


def _gains(rows, information):
    """Return the growth (N,) of log det `information` by each of the candidates `rows` (N, m, p)."""
    spread = np.linalg.solve(information, np.swapaxes(rows, 1, 2))
    return np.linalg.slogdet(np.eye(rows.shape[1]) + rows @ spread)[1]


def _tour(machine, q):
    """Return `q` (N, n) in the order of the nearest neighbour, from home on."""
    left, order, at = list(range(len(q))), [], machine.home
    while left:
        nearest = min(left, key=lambda index: (np.abs(q[index] - at).max(), index))
        order.append(nearest)
        left.remove(nearest)
        at = q[nearest]
    return q[order]
