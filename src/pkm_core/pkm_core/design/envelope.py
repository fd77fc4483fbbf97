"""
The exact workspace of the 4-DOF manipulator: the reachable orientations at a position, in closed form.

With the end-effector held at (x, y, z), P and Q lie on a circle of radius R = sqrt(k10^2 - (z - dz)^2) and phi is the
only freedom. Slider d1 is at a limit D if P is at distance l2 from its pivot (D, dy), an intersection of two circles.
This gives all orientations with a slider at a limit; between neighbouring ones reachability does not change.
Source: (2.11)-(2.14), (2.20)-(2.26) with the signs of machines/four_dof.py.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.errors import WorkspaceError
from pkm_core.machines.base import ROUNDING

_BLOCK = 1 << 14  # points per block, whose arrays fit into the cache


class OrientationRange(NamedTuple):
    """Reachable orientations at given points, arrays (...,) [rad]; NaN for points out of reach."""

    lowest: np.ndarray
    highest: np.ndarray
    gap: np.ndarray  # total of the unreachable ranges between the two


def orientation_range(machine, points):
    """
    Return the `OrientationRange` of `machine`, a four_dof, at the positions `points` (..., 3) [m].

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> at = orientation_range(load_machine('four_dof'), [0.09137, 0.09137, 0.1235])
    >>> np.degrees(at).round(2)
    array([-60.78, -29.22,   0.  ])

    """

    def block(part):
        phi = np.sort(_at_limits(machine, part), axis=1)  # NaN last
        feasible = _reaches(machine, part, phi)
        lowest = np.where(feasible, phi, np.inf).min(axis=1, keepdims=True)
        highest = np.where(feasible, phi, -np.inf).max(axis=1, keepdims=True)
        between = 0.5 * (phi[:, :-1] + phi[:, 1:])
        missed = (between > lowest) & (between < highest) & ~_reaches(machine, part, between)
        gap = np.where(missed, np.diff(phi, axis=1), 0.0).sum(axis=1, keepdims=True)
        return np.where(np.isfinite(lowest), np.hstack([lowest, highest, gap]), np.nan)

    return OrientationRange(*np.moveaxis(_in_blocks(machine, points, block), -1, 0))


def reached_with(machine, points, lowest, highest):
    """
    Return whether a four_dof reaches every orientation from `lowest` to `highest` [rad] at `points` (..., 3) [m].

    Equal bounds give the constant-orientation workspace, a range the dexterous one.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> reached_with(load_machine('four_dof'), [0.09137, 0.09137, 0.1235], np.radians(-50), np.radians(-40))
    array(True)

    """
    if not lowest <= highest:
        raise WorkspaceError(
            f'orientations from {np.degrees(lowest):g} to {np.degrees(highest):g} deg: inverted; expected ascending'
        )

    def block(part):
        ends = np.tile([lowest, highest], (len(part), 1))
        phi = np.nan_to_num(_at_limits(machine, part), nan=lowest).clip(lowest, highest)
        phi = np.sort(np.hstack([ends, phi]), axis=1)
        phi = np.hstack([phi, 0.5 * (phi[:, :-1] + phi[:, 1:])])
        return _reaches(machine, part, phi).all(axis=1)

    return _in_blocks(machine, points, block)


def clearance(machine, points):
    """
    Return the least distance (...,) [m] of a slider of a four_dof from its limits at `points` (..., 3) [m].

    It is that of the best orientation. The distance is continuous, 0 on the boundary of the workspace and negative
    outside: its level surface is the envelope. The best orientation is searched on a grid, refined four times, to an
    accuracy of 0.1 um of clearance.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> (1e3 * clearance(load_machine('four_dof'), [[0.09137, 0.09137, 0.1235], [0.09137, 0.09137, 0.12525]])).round(2)
    array([17.69, -3.04])

    """

    def block(part):
        phi = np.tile(np.linspace(-0.5 * np.pi, 0.0, 66)[1:-1], (len(part), 1))
        step = phi[0, 1] - phi[0, 0]
        for _ in range(4):
            best = _slack(machine, part, phi).argmax(axis=1)[:, np.newaxis]
            phi = np.take_along_axis(phi, best, axis=1) + step * np.linspace(-1.0, 1.0, 17)
            step /= 8.0
        return _slack(machine, part, phi).max(axis=1)

    return _in_blocks(machine, points, block)


def _in_blocks(machine, points, block):
    """Return the results of `block`, called with _BLOCK points (N, 3) at a time, in the shape of `points` (..., 3)."""
    points = np.asarray(points, dtype=float)
    if machine.config.mechanism != 'four_dof':
        raise WorkspaceError(f'{machine.name} is a {machine.config.mechanism}; expected a four_dof')
    if points.shape[-1:] != (3,):
        raise WorkspaceError(f'points have shape {points.shape}; expected (..., 3) for x, y, z')
    if not np.isfinite(points).all():
        raise WorkspaceError('points: a coordinate is not finite; expected finite numbers')
    flat = points.reshape(-1, 3)
    with np.errstate(invalid='ignore', divide='ignore'):  # circles without intersection give NaN
        results = np.concatenate([block(flat[i : i + _BLOCK]) for i in range(0, max(len(flat), 1), _BLOCK)])
    return results.reshape((*points.shape[:-1], *results.shape[1:]))


def _radius(machine, points):
    """Return half of PQ (N, 1) [m] at `points`; beyond the reach of links 10 and 12, its value at the end of reach."""
    geometry = machine.config.geometry
    Z = (points[:, 2:] - geometry.dz).clip(0.0, geometry.k10)
    return np.sqrt(geometry.k10**2 - Z**2)


def _at_limits(machine, points):
    """Return the orientations (N, 16) [rad] with a slider at a limit; NaN for circles without intersection."""
    geometry, limits = machine.config.geometry, machine.limits
    x, y, R = points[:, :1], points[:, 1:2], _radius(machine, points)
    ends = np.stack([limits.lower, limits.upper])
    a = np.hstack([x - ends[:, :2].reshape(1, 4), np.repeat(x - geometry.dx, 4, axis=1)])
    b = np.hstack([np.repeat(y - geometry.dy, 4, axis=1), y - ends[:, 2:].reshape(1, 4)])
    # P = (x, y) + R (cos, sin) and Q = (x, y) - R (cos, sin) are at distance l2 from a pivot if a cos + b sin = along
    side = np.repeat([1.0, -1.0], 4)
    along = side * (geometry.l2**2 - R**2 - a**2 - b**2) / (2.0 * R)
    half, middle = np.arccos(along / np.hypot(a, b)), np.arctan2(b, a)
    phi = np.remainder(np.hstack([middle - half, middle + half]) + np.pi, 2.0 * np.pi) - np.pi
    return np.where((phi > -0.5 * np.pi) & (phi < 0.0), phi, np.nan)  # branch (2.15)


def _slack(machine, points, phi):
    """
    Return the least distance (N, m) [m] of a slider from its limits at the orientations `phi` (N, m).

    It is negative beyond a limit. Where the links do not reach it is continued by a continuous negative function.
    """
    geometry, limits = machine.config.geometry, machine.limits
    x, y, R = points[:, :1], points[:, 1:2], _radius(machine, points)
    across, along = R * np.cos(phi), R * np.sin(phi)
    least = np.inf
    for middle, height, lower, higher in (
        (x + across, y + along - geometry.dy, 0, 1),  # P on d1, d3
        (y - along, x - across - geometry.dx, 3, 2),  # Q on d7, d5
    ):
        square = geometry.l2**2 - height**2
        half_gap = np.copysign(np.sqrt(np.abs(square)), square)
        least = np.minimum(least, height)  # below the guide the assembly is another one
        for joint, d in ((lower, middle - half_gap), (higher, middle + half_gap)):
            least = np.minimum(least, np.minimum(d - limits.lower[joint], limits.upper[joint] - d))
    return least


def _reaches(machine, points, phi):
    return _slack(machine, points, phi) >= -ROUNDING  # False for NaN
