"""
Comparison of linkage modules and layouts (thesis ch. 2): base area, workspace, conditioning, error of link lengths.

Every machine is taken as guided pairs, whatever its mechanism, so that all are measured by the same equations.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.design.workspace import Measured, measure, pose_volume, sample_joints
from pkm_core.errors import PkmError, WorkspaceError
from pkm_core.machines.base import ROUNDING
from pkm_core.machines.guided_pair import guided_pair
from pkm_core.machines.kinematic import CORE_ORDER
from pkm_core.machines.layout_core import LayoutCore

COMPARED = ('planar', 'h_linkage', 'v_linkage', 'four_dof', 'parallel_layout')
TITLES = {
    'planar': 'triangular (T) module',
    'h_linkage': 'H-linkage',
    'v_linkage': 'V-linkage',
    'four_dof': 'orthogonal layout',
    'parallel_layout': 'parallel layout',
}
# half sides of the box of poses about home for which the travel is compared; chosen: the links of all reach it
TASK = {'x': 3e-3, 'y': 3e-3, 'z': 0.5e-3, 'phi': np.radians(3.0)}


class LayoutFigures(NamedTuple):
    """Figures of one machine; lengths in m, angles in rad."""

    title: str
    base: tuple[float, float]  # sides of the rectangle along X and Y around guides, joints and functional points
    workspace: Measured  # [m^2] of (x, y), or [m^3] of (x, y, z) with any phi
    condition: tuple[float, float]  # of the Jacobian: at home, largest of the samples
    conditioning: float  # mean of 1 / condition number, the global conditioning index
    position: tuple[float, float]  # error per link error [m/m]: mean and largest of the samples
    orientation: tuple[float, float] | None  # of phi [rad/m]
    travel: np.ndarray  # (n,) travel of each slider for `TASK`

    @property
    def area(self):
        """Area of the base [m^2]."""
        return self.base[0] * self.base[1]


def pairs_of(machine):
    """
    Return the machine as a `GuidedPair` or a `LayoutCore`, in its drawn lengths.

    Raises
    ------
    PkmError
        If it has no links.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> type(pairs_of(load_machine('four_dof'))).__name__
    'LayoutCore'

    """
    config = machine.config
    if config.mechanism == 'linkage':
        return machine.pair
    if config.mechanism == 'layout':
        return machine.core
    if config.mechanism not in ('planar', 'four_dof'):
        raise PkmError(f'{machine.name}: a {config.mechanism} has no links; expected planar, four_dof, linkage, layout')
    geometry, zero = config.geometry, np.zeros((2, 2))
    at_p = guided_pair(zero, [0.0, 0.0], geometry.l2, 'left', machine.home[:2], geometry.dy)
    if config.mechanism == 'planar':
        return at_p
    along_y = [0.5 * np.pi] * 2
    at_q = guided_pair(zero, along_y, geometry.l2, 'right', machine.home[CORE_ORDER[2:]], geometry.dx)
    return LayoutCore(at_p, at_q, geometry.k10, geometry.dz, 0.75 * np.pi)


def compare(machines, samples, seed, length, on_step=lambda name: None):
    """
    Return {name: LayoutFigures} of machines.

    Parameters
    ----------
    machines : sequence of Machine
        Machines with links.
    samples : int
        Joint positions, drawn uniformly within the travel (2.4).
    seed : int
        Seed of the samples.
    length : float
        Radius on which an angle is taken as an arc in condition numbers [m].
    on_step : callable
        Called with the name of each machine when it begins.

    Raises
    ------
    PkmError
        If a machine has no links or is given twice, or its links do not reach `TASK`.

    """
    found: dict[str, LayoutFigures] = {}
    for machine in machines:
        if machine.name in found:
            raise PkmError(f'machines: {machine.name} is given twice; expected different names')
        on_step(machine.name)
        found[machine.name] = layout_figures(machine, samples, seed, length)
    return found


def layout_figures(machine, samples, seed, length):
    """Return the `LayoutFigures` of `machine`; arguments and errors of `compare`."""
    core, spatial = pairs_of(machine), 'phi' in machine.coordinates
    order = CORE_ORDER if spatial else np.arange(2)
    q = sample_joints(machine, samples, seed)
    moves, stretches = core.rates(q[:, order])
    scale = np.array([length if name == 'phi' else 1.0 for name in machine.coordinates])[:, np.newaxis]
    condition = np.linalg.cond(scale * moves)
    of_position = np.sqrt(np.sum(stretches[:, : 3 if spatial else 2] ** 2, axis=(1, 2)))
    orientation = None
    if spatial:
        of_phi = np.linalg.norm(stretches[:, 3], axis=1)
        orientation = (float(of_phi.mean()), float(of_phi.max()))
    home = float(np.linalg.cond(scale * core.rates(machine.home[order])[0]))
    return LayoutFigures(
        TITLES.get(machine.name, machine.config.mechanism),
        tuple(np.ptp(plan_points(machine, core), axis=0)),
        _workspace(machine, core, seed),
        (home, float(condition.max())),
        float(np.mean(1.0 / condition)),
        (float(of_position.mean()), float(of_position.max())),
        orientation,
        _task_travel(machine),
    )


def plan_points(machine, core, nodes=9):
    """Return points (N, 2) [m] in the plan: pivots, joints and functional points over a grid of the travel."""
    modules = (core.p, core.q) if isinstance(core, LayoutCore) else (core,)
    order = CORE_ORDER if len(modules) == 2 else np.arange(2)
    lower, upper = machine.limits.lower[order], machine.limits.upper[order]
    points = []
    for k, module in enumerate(modules):
        ends = np.linspace(lower[2 * k : 2 * k + 2], upper[2 * k : 2 * k + 2], nodes)
        q = np.stack(np.meshgrid(*ends.T, indexing='ij'), axis=-1).reshape(-1, 2)
        place = np.stack(module.place(q), axis=-1)
        pivots = module.pivots(q)
        points += [pivots[:, 0], pivots[:, 1], place, place - module.offset]
        if getattr(machine.config.geometry, 'bar', False):  # its blocks run on both guides, beside the joint
            for i in range(2):
                reach = np.sum((place - module.origins[i]) * module.directions[i], axis=1)
                points.append(module.origins[i] + reach[:, np.newaxis] * module.directions[i])
    return np.concatenate(points)


def _task_travel(machine):
    """Return the travel (n,) [m] of each slider over the corners, edges and faces of `TASK` about home."""
    sides = [np.array([-1.0, 0.0, 1.0]) * TASK[name] for name in machine.coordinates]
    poses = machine.forward(machine.home) + np.stack(np.meshgrid(*sides, indexing='ij'), axis=-1)
    try:
        return np.ptp(machine.inverse(poses.reshape(-1, len(sides))), axis=0)
    except WorkspaceError as error:
        raise PkmError(f'{machine.name}: poses 3 mm about home, at which travel is compared: {error}') from None


def _workspace(machine, core, seed):
    """Return the `Measured` size of all positions: exact in the plane, quasi-Monte-Carlo in space."""
    if not isinstance(core, LayoutCore):
        return Measured(pose_volume(machine), 0.0)
    poses = machine.forward(sample_joints(machine, 20_000, seed))
    ends = machine.forward(np.stack(np.meshgrid(*_ends(machine), indexing='ij'), axis=-1).reshape(-1, 4))
    everywhere = np.concatenate([poses, ends])[:, :3]
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    margin = 0.1 * (high - low)
    return measure(lambda points: _reached(machine, core, points), low - margin, high + margin, seed, 1 << 13, 4)


def _ends(machine):
    return np.stack([machine.limits.lower, machine.limits.upper], axis=1)


def _reached(machine, core, points):
    """Return whether some phi at each position (N, 3) is within the travel of all sliders."""
    lower, upper = machine.limits.lower[CORE_ORDER], machine.limits.upper[CORE_ORDER]
    Z = points[:, 2] - core.dz
    with np.errstate(invalid='ignore', divide='ignore'):  # NaN: out of reach
        R = np.sqrt(core.k10**2 - Z * Z)[:, np.newaxis]
        phi = _at_limits(core, points, R, (lower, upper))
        turn = np.remainder(phi - core.heading, 2.0 * np.pi) - np.pi  # from home
        inside = (Z[:, np.newaxis] > 0.0) & (np.abs(turn) < 0.5 * np.pi)
        for k, (pair, sign) in enumerate(((core.p, 1.0), (core.q, -1.0))):
            joint = points[:, np.newaxis, :2] + sign * R[..., np.newaxis] * np.stack(
                [np.cos(phi), np.sin(phi)], axis=-1
            )
            joint = joint - pair.offset
            for i in range(2):
                to, u = joint - pair.origins[i], pair.directions[i]
                over = u[0] * to[..., 1] - u[1] * to[..., 0]
                d = to @ u - pair.signs[i] * np.sqrt(pair.links[i] ** 2 - over**2)
                inside &= (d >= lower[2 * k + i] - ROUNDING) & (d <= upper[2 * k + i] + ROUNDING)
                inside &= pair.side * over > 0.0  # the modules of a layout are T-mechanisms
    return inside.any(axis=1)


def _at_limits(core, points, R, limits):
    """
    Return the orientations (N, 16) [rad] with a slider at a limit, NaN without one; the interval of phi ends there.

    The joint is then on the circle around the pivot: c + R e is as long as the link, with e the direction of P or -Q.
    """
    found = []
    for k, (pair, sign) in enumerate(((core.p, 1.0), (core.q, -1.0))):
        for i in range(2):
            for end in limits:
                pivot = pair.origins[i] + end[2 * k + i] * pair.directions[i]
                c = sign * (points[:, :2] - pair.offset - pivot)
                square = np.sum(c * c, axis=1)
                cosine = (pair.links[i] ** 2 - R[:, 0] ** 2 - square) / (2.0 * R[:, 0] * np.sqrt(square))
                middle, half = np.arctan2(c[:, 1], c[:, 0]), np.arccos(cosine)
                found += [middle - half, middle + half]
    return np.stack(found, axis=1)
