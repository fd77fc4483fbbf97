"""
Magnification of link errors by a design over a workspace: f of Ryu and Cha, f1 (4.20), f2 (4.21), and statistics.

The integrals are means over the poses. All objectives combine rows of m/m and one of rad/m; `arm` is the radius [m]
that converts an angle to a length. 1 mm gives the numbers of the thesis, which uses mm and rad/mm.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.design.error_matrix import em_thesis, em_true, geometry_of, linkage
from pkm_core.design.workspace import sample_joints

VARIANTS = {'thesis': em_thesis, 'true': em_true}
_BLOCK = 100_000  # error matrices per block


class Objectives(NamedTuple):
    """Values for one or more designs, arrays (...,); infinite if a pose is out of reach."""

    f: np.ndarray  # mean of the product of the singular values
    f1: np.ndarray  # mean of the sum of their squares
    f2: np.ndarray  # largest sum of their squares
    size: np.ndarray  # from the crossing of the guides to the farthest slider [m]


def objectives(geometry, poses, variant='true', arm=1e-3):
    """
    Return the `Objectives` of a `Geometry`, whose l2 and k10 may be arrays (...,), over `poses` (N, 4).

    Examples
    --------
    >>> from pkm_core.design.operational_workspace import load_operational_workspace
    >>> W = load_operational_workspace('chapter4')
    >>> found = objectives(W.geometry(0.150, 0.150), W.workspace.poses_at_middle_angle(), 'thesis')
    >>> [round(float(value), 3) for value in found[:3]]  # Table 4.1
    [0.562, 153.125, 626.627]

    """
    l2, k10 = np.broadcast_arrays(np.asarray(geometry.l2, dtype=float), np.asarray(geometry.k10, dtype=float))
    designs = np.stack([l2.ravel(), k10.ravel()])
    step = max(1, _BLOCK // len(poses))
    blocks = [
        _block(geometry._replace(l2=part[0][:, np.newaxis], k10=part[1][:, np.newaxis]), poses, variant, arm)
        for part in (designs[:, i : i + step] for i in range(0, designs.shape[1], step))
    ]
    return Objectives(*(np.concatenate(part).reshape(l2.shape) for part in zip(*blocks, strict=True)))


def squared_norms(geometry, poses, variant='true', arm=1e-3):
    """Return the sum of the squared singular values (4.19) of one `Geometry` at each of `poses` (N, 4): (N,)."""
    E = _scaled(linkage(geometry, poses), variant, arm)
    return np.sum(E**2, axis=(-2, -1))


def _scaled(at, variant, arm):
    return VARIANTS[variant](at) * np.array([1.0, 1.0, 1.0, arm])[:, np.newaxis]


@np.errstate(divide='ignore', invalid='ignore', over='ignore')  # poses out of reach give NaN
def _block(geometry, poses, variant, arm):
    at = linkage(geometry, poses)
    E = _scaled(at, variant, arm)
    squares = np.sum(E**2, axis=(-2, -1))
    products = np.sqrt(np.abs(np.linalg.det(E @ np.swapaxes(E, -1, -2))))
    found = (products.mean(axis=-1), squares.mean(axis=-1), squares.max(axis=-1), at.joints().max(axis=(-2, -1)))
    out = ~np.isfinite(squares).all(axis=-1)
    return [np.where(out, np.inf, value) for value in found]


def reachable_magnification(machine, samples, seed, arm=1e-3):
    """
    Return the error magnification by `em_true` of a four_dof at `samples` positions drawn uniformly in its joints.

    Returns
    -------
    squares : ndarray, shape (samples,)
        Sum of the squared singular values (4.19), angles on the `arm` [m].
    together : ndarray, shape (samples, 4)
        Error when every link is 1 um too long [m, rad].
    worst : ndarray, shape (samples, 4)
        Error when each link is 1 um too long or too short, with the signs that add up [m, rad].

    """
    poses = machine.forward(sample_joints(machine, samples, seed))
    geometry = geometry_of(machine)
    E = em_true(linkage(geometry, poses))
    return squared_norms(geometry, poses, 'true', arm), 1e-6 * E.sum(axis=-1), 1e-6 * np.abs(E).sum(axis=-1)


class Statistics(NamedTuple):
    """Statistics of one coordinate of the end-point error over W [m or rad]."""

    minimum: float
    maximum: float
    mean: float
    deviation: float  # with N - 1


def error_statistics(geometry, poses, variant='true', error=1e-6):
    """
    Return {coordinate: Statistics} of the end-point error over `poses` when every link is `error` [m] too long.

    Source: Tables 4.2-4.5; their last column is in urad, not in mdeg as printed.
    """
    E = VARIANTS[variant](linkage(geometry, poses))
    errors = error * E.sum(axis=-1)
    return {
        name: Statistics(*map(float, (column.min(), column.max(), column.mean(), column.std(ddof=1))))
        for name, column in zip(('x', 'y', 'z', 'phi'), errors.T, strict=True)
    }
