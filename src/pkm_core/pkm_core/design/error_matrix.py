"""
The error manipulation matrix (4.17): effect of small errors of six links on the end point of a four_dof.

Rows x, y, z [m/m] and phi [rad/m]; columns l2, l4, l6, l8, k10, k12. `em_true` is the derivative, confirmed by finite
differences. `em_thesis` reproduces Tables 4.1-4.5 of the thesis: in its z row the terms of links 2 to 8 have the wrong
sign, and two of them lack a factor l. Use only `em_true` for engineering.
"""

from typing import Any, NamedTuple

import numpy as np

from pkm_core.errors import WorkspaceError


class Geometry(NamedTuple):
    """Lengths of links 2 to 8, of links 10 and 12, and offsets [m]; numbers or arrays that broadcast with the poses."""

    l2: Any
    k10: Any
    dx: float
    dy: float
    dz: float


class Linkage(NamedTuple):
    """Inner lengths [m] at given poses, arrays (...,); NaN for poses out of reach."""

    l2: Any
    k10: Any
    g1: np.ndarray  # d3 - d1
    g2: np.ndarray  # d5 - d7
    Y: np.ndarray  # y1 - dy
    X: np.ndarray  # x2 - dx
    wx: np.ndarray  # x2 - x1
    wy: np.ndarray  # y2 - y1
    Z: np.ndarray  # z - dz
    x1: np.ndarray  # of P along its guide
    y2: np.ndarray  # of Q along its guide

    def joints(self):
        """Return the joint positions (..., 4) [m]."""
        h1, h2 = 0.5 * self.g1, 0.5 * self.g2
        return np.stack(np.broadcast_arrays(self.x1 - h1, self.x1 + h1, self.y2 + h2, self.y2 - h2), axis=-1)


def geometry_of(machine):
    """Return the `Geometry` of a four_dof."""
    if machine.config.mechanism != 'four_dof':
        raise WorkspaceError(f'{machine.name} is a {machine.config.mechanism}; the error matrix is that of a four_dof')
    geometry = machine.config.geometry
    return Geometry(geometry.l2, geometry.k10, geometry.dx, geometry.dy, geometry.dz)


def linkage(geometry, poses):
    """Return the `Linkage` of `geometry` at `poses` (..., 4) [m, rad], by (2.11)-(2.14) and (2.20)-(2.26)."""
    x, y, z, phi = np.moveaxis(np.asarray(poses, dtype=float), -1, 0)
    l2, k10, dx, dy, dz = geometry
    with np.errstate(invalid='ignore'):
        Z = z - dz
        R = np.sqrt(k10 * k10 - Z * Z)
        across, along = R * np.cos(phi), R * np.sin(phi)
        Y, X = y + along - dy, x - across - dx
        reached = (Y > 0.0) & (X > 0.0) & (Z > 0.0) & (phi > -0.5 * np.pi) & (phi < 0.0)  # of this assembly
        Y, X = np.where(reached, Y, np.nan), np.where(reached, X, np.nan)
        h1, h2 = np.sqrt(l2 * l2 - Y * Y), np.sqrt(l2 * l2 - X * X)
    return Linkage(l2, k10, 2.0 * h1, 2.0 * h2, Y, X, -2.0 * across, -2.0 * along, Z, x + across, y - along)


def check_reach(geometry, poses):
    """Raise `WorkspaceError` with length, pose and need if `geometry` does not reach all `poses` (N, 4)."""
    poses = np.asarray(poses, dtype=float)
    if not (np.isfinite(poses).all() and np.isfinite(geometry).all()):
        raise WorkspaceError(f'a length or pose is not finite: {geometry}; expected finite numbers')

    def refuse(i, what, need):
        x, y, z = 1e3 * poses[i, :3]
        raise WorkspaceError(f'{what}: the pose ({x:g}, {y:g}, {z:g} mm, {np.degrees(poses[i, 3]):g} deg) needs {need}')

    l2, k10, phi = geometry.l2, geometry.k10, poses[:, 3]
    if not ((phi > -0.5 * np.pi) & (phi < 0.0)).all():
        refuse(np.abs(phi + 0.25 * np.pi).argmax(), 'another assembly', 'phi between -90 and 0 deg (2.15)')
    Z = poses[:, 2] - geometry.dz
    if Z.min() <= 0.0:
        refuse(Z.argmin(), 'the end-effector is below P and Q', f'z above dz = {1e3 * geometry.dz:g} mm')
    if Z.max() >= k10:
        refuse(Z.argmax(), f'k = {1e3 * k10:g} mm is too short', f'k above {1e3 * Z.max():.5g} mm')
    R = np.sqrt(k10**2 - Z**2)
    Y = poses[:, 1] + R * np.sin(phi) - geometry.dy
    X = poses[:, 0] - R * np.cos(phi) - geometry.dx
    for name, height in (('y1 - dy', Y), ('x2 - dx', X)):
        if height.max() >= l2:
            refuse(height.argmax(), f'l = {1e3 * l2:g} mm is too short', f'l above {1e3 * height.max():.5g} mm')
        if height.min() <= 0.0:
            i = height.argmin()
            refuse(i, f'k = {1e3 * k10:g} mm is too long', f'{name} above 0 mm; it is {1e3 * height[i]:.4g} mm')


def em_true(at):
    """
    Return the error matrix (..., 4, 6) at the `Linkage` `at`.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> machine = load_machine('four_dof')
    >>> em_true(linkage(geometry_of(machine), machine.forward(machine.home)))[2].round(4)
    array([-0.0489,  0.1371,  0.1371, -0.0489,  0.5125,  0.5125])

    """
    a, b = -at.wx * at.l2 / (4.0 * at.Z * at.g1), -at.wy * at.l2 / (8.0 * at.Z * at.Y)
    c, d = at.wx * at.l2 / (8.0 * at.Z * at.X), at.wy * at.l2 / (4.0 * at.Z * at.g2)
    return _matrix(at, (-a - b, a - b, -c + d, -c - d))


def em_thesis(at):
    """Return the error matrix (..., 4, 6) that reproduces the tables of the thesis; see the module."""
    a, b = -at.wx * at.l2 / (4.0 * at.Z * at.g1), -at.wy * 1e-3 / (8.0 * at.Z * at.Y)  # 1 mm in place of l2
    c, d = at.wx * at.l2 / (8.0 * at.Z * at.X), at.wy * at.l2 / (4.0 * at.Z * at.g2)
    return _matrix(at, (a + b, -a + b, c - d, c + d))


def _matrix(at, z_of_planar_links):
    l2, k10, D2 = at.l2, at.k10, at.wx**2 + at.wy**2
    e11, e12 = l2 / (2.0 * at.g1), l2 / (4.0 * at.X)
    e21, e22 = l2 / (4.0 * at.Y), l2 / (2.0 * at.g2)
    e13, e23 = k10 * at.wx / D2, k10 * at.wy / D2  # -k cos(phi) / D and -k sin(phi) / D
    e35 = k10 / (2.0 * at.Z)
    along1, across1 = l2 / D2 * at.wy / at.g1, l2 / D2 * at.wx / (2.0 * at.Y)
    along2, across2 = l2 / D2 * at.wx / at.g2, l2 / D2 * at.wy / (2.0 * at.X)
    e31, e32, e33, e34 = z_of_planar_links
    zero = 0.0 * e35
    rows = (
        (e11, -e11, e12, e12, e13, -e13),
        (e21, e21, -e22, e22, e23, -e23),
        (e31, e32, e33, e34, e35, e35),
        (along1 - across1, -along1 - across1, -along2 - across2, along2 - across2, zero, zero),
    )
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)
