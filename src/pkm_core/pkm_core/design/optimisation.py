"""Search for the link lengths of least error magnification over an operational workspace (chapter 4)."""

from typing import NamedTuple

import numpy as np

from pkm_core.design.objectives import Objectives, objectives
from pkm_core.errors import WorkspaceError


class Scan(NamedTuple):
    """Objectives over a grid of designs, arrays (n, n): rows are l, columns k [m]."""

    l2: np.ndarray
    k10: np.ndarray
    objectives: Objectives


class Optimum(NamedTuple):
    """The best design of one objective."""

    l2: float  # [m]
    k10: float  # [m]
    value: float


def scan(workspace, poses, bounds, variant='true', arm=1e-3, points=61):
    """
    Return the `Scan` of `points` x `points` designs within `bounds` over `poses` (N, 4).

    The designs have the offsets of the `OperationalWorkspace` `workspace`.
    """
    spans = (np.linspace(span.lower, span.upper, points) for span in (bounds.l, bounds.k))
    l2, k10 = np.meshgrid(*spans, indexing='ij')
    return Scan(l2, k10, objectives(workspace.geometry(l2, k10), poses, variant, arm))


def optimum(workspace, poses, name, variant='true', arm=1e-3):
    """
    Return the `Optimum` of the objective `name` ('f', 'f1', 'f2') within the bounds of `workspace`.

    The best design of a scan is refined by the simplex search of Nelder and Mead, because f2 is not differentiable.

    Raises
    ------
    WorkspaceError
        If no design within the bounds reaches all poses.

    Examples
    --------
    >>> from pkm_core.design.operational_workspace import load_operational_workspace
    >>> W = load_operational_workspace('chapter4')
    >>> best = optimum(W, W.workspace.poses_at_middle_angle(), 'f1', 'thesis')  # Table 4.1: 70 mm, 118.6 mm, 3.535
    >>> round(1e3 * best.l2, 3), round(1e3 * best.k10, 3), round(best.value, 4)
    (70.0, 118.655, 3.5349)

    """
    from scipy.optimize import minimize

    bounds = workspace.bounds
    found = scan(workspace, poses, bounds, variant, arm, points=21)
    values = getattr(found.objectives, name)
    start = np.unravel_index(values.argmin(), values.shape)
    if not np.isfinite(values[start]):
        raise WorkspaceError(
            'empty search: no design reaches all poses of the workspace with '
            + ' and '.join(
                f'{symbol} from {1e3 * span.lower:g} to {1e3 * span.upper:g} mm'
                for symbol, span in (('l', bounds.l), ('k', bounds.k))
            )
        )
    best = minimize(
        lambda design: float(getattr(objectives(workspace.geometry(*(1e-3 * design)), poses, variant, arm), name)),
        1e3 * np.array([found.l2[start], found.k10[start]]),  # mm: the tolerances of the search are absolute
        bounds=[(1e3 * span.lower, 1e3 * span.upper) for span in (bounds.l, bounds.k)],
        method='Nelder-Mead',
        options={'xatol': 1e-7, 'fatol': 1e-13, 'maxiter': 2000},
    )
    return Optimum(*map(float, (*(1e-3 * best.x), best.fun)))


class Pareto(NamedTuple):
    """Designs that no other design improves in all costs, arrays (n,) in order of size."""

    l2: np.ndarray  # [m]
    k10: np.ndarray  # [m]
    f1: np.ndarray
    f2: np.ndarray
    size: np.ndarray  # [m]


def pareto_front(workspace, poses, variant='true', arm=1e-3, points=81):
    """
    Return the `Pareto` front of f1, f2 and size among `points` x `points` designs of the range `workspace.pareto`.

    The whole range of the two lengths is evaluated, so the front is exact to the step of the grid.
    """
    found = scan(workspace, poses, workspace.pareto, variant, arm, points)
    costs = np.stack([found.objectives.size.ravel(), found.objectives.f1.ravel(), found.objectives.f2.ravel()], axis=1)
    designs = np.stack([found.l2.ravel(), found.k10.ravel()], axis=1)
    reached = np.isfinite(costs).all(axis=1)
    if not reached.any():
        raise WorkspaceError('empty search: no design of the Pareto range reaches all poses of the workspace')
    costs, designs = costs[reached], designs[reached]
    order = np.lexsort(costs.T[::-1])
    costs, designs = costs[order], designs[order]
    front = not_dominated(costs)
    size, f1, f2 = costs[front].T
    return Pareto(*designs[front].T, f1, f2, size)


def not_dominated(costs):
    """
    Return a mask (N,) of the rows of `costs` (N, m) that no other row dominates: lower in one, higher in none.

    Examples
    --------
    >>> not_dominated(np.array([[1.0, 4.0], [2.0, 2.0], [3.0, 3.0], [4.0, 1.0]]))
    array([ True,  True, False,  True])

    """
    kept = np.ones(len(costs), dtype=bool)
    for i, row in enumerate(costs):
        if kept[i]:
            kept &= ~((costs >= row).all(axis=1) & (costs > row).any(axis=1))
    return kept
