"""
4-DOF parallel manipulator: two planar T-mechanisms on crossed guides carry a vertical one with the end-effector.

Sliders d1, d3 run along X and carry P = (x1, y1); d5, d7 run along Y and carry Q = (x2, y2). Links 10 and 12 rise from
P and Q and meet at the end-effector (x, y, z), which a belt keeps level and which turns about Z with PQ by phi.
Source: thesis ch. 2, 3, 5 and Table 6.1. phi is that of (2.19), right-handed about +Z, -45 deg at mid travel; the
printed signs of (2.25), (2.26) belong to -phi.
"""

from typing import Any, NamedTuple

import numpy as np

from pkm_core import dynamics
from pkm_core.jet import stack, value
from pkm_core.machines.base import Machine
from pkm_core.machines.checks import check_between
from pkm_core.machines.four_dof_config import FourDofConfig
from pkm_core.machines.t_mechanism import heights, margins

_GAPS = ('d3 - d1', 'd5 - d7')


class _Linkage(NamedTuple):
    """Inner lengths [m] at a joint position, arrays or Jets (...,)."""

    gaps: Any  # (..., 2): d3 - d1, d5 - d7
    Y1: Any  # height of P over the X guide, without dy
    X2: Any  # of Q over the Y guide, without dx
    wx: Any  # PQ
    wy: Any
    Z: Any  # height of the end-effector's joint over P and Q


class FourDof(Machine):
    """See the module; q = [d1, d3, d5, d7], x = [x, y, z, phi]."""

    Config = FourDofConfig
    joints = ('d1', 'd3', 'd5', 'd7')
    coordinates = ('x', 'y', 'z', 'phi')
    parameters = dynamics.FOUR_DOF_PARAMETERS
    terms = staticmethod(dynamics.four_dof_terms)
    rows = staticmethod(dynamics.four_dof_rows)

    def forward(self, q):
        """Return (x, y, z, phi) of (2.5)-(2.8), (2.16)-(2.19) at `q`; see `Machine.forward`."""
        q = self._joints(q)
        geometry = self.config.geometry
        at = self._linkage(q)
        x1, y2 = 0.5 * (q[..., 0] + q[..., 1]), 0.5 * (q[..., 2] + q[..., 3])
        x2, y1 = at.X2 + geometry.dx, at.Y1 + geometry.dy
        return stack([0.5 * (x1 + x2), 0.5 * (y1 + y2), at.Z + geometry.dz, np.arctan(at.wy / at.wx)])

    def inverse(self, x):
        """Return (d1, d3, d5, d7) of (2.11)-(2.14), (2.20)-(2.26) at the pose `x`; see `Machine.inverse`."""
        x = self._pose(x)
        l2, k10 = self.config.geometry.l2, self.config.geometry.k10
        dx, dy, dz = self.config.geometry.dx, self.config.geometry.dy, self.config.geometry.dz
        # z below dz and phi beyond a quarter turn are other assemblies, which no motion of the sliders leads to
        check_between(value(x)[..., 2:3], dz, dz + k10, ('z',), 'length of links 10 and 12')
        check_between(value(x)[..., 3:], -0.5 * np.pi, 0.0, ('phi',), 'branch (2.15)')
        Z, phi = x[..., 2] - dz, x[..., 3]
        R = np.sqrt(k10 * k10 - Z * Z)  # half the length of PQ
        half_x, half_y = R * np.cos(phi), R * np.sin(phi)
        x1, y1 = x[..., 0] + half_x, x[..., 1] + half_y
        x2, y2 = x[..., 0] - half_x, x[..., 1] - half_y
        check_between(value(y1)[..., None], dy, dy + l2, ('y1',), 'reach of links 2 and 4 (2.10)')
        check_between(value(x2)[..., None], dx, dx + l2, ('x2',), 'reach of links 6 and 8 (2.10)')
        Y1, X2 = y1 - dy, x2 - dx
        half_gap1, half_gap2 = np.sqrt(l2 * l2 - Y1 * Y1), np.sqrt(l2 * l2 - X2 * X2)
        return stack([x1 - half_gap1, x1 + half_gap1, y2 + half_gap2, y2 - half_gap2])

    def jacobian(self, q):
        """Return J = J_H J_q (..., 4, 4) [m/m; phi: rad/m] of (3.16)-(3.21); see `Machine.jacobian`."""
        at = self._linkage(self._joints(q))
        c1, c2 = 0.25 * at.gaps[..., 0] / at.Y1, 0.25 * at.gaps[..., 1] / at.X2
        J_q = np.zeros((*at.Z.shape, 4, 4))  # rows x1, y1, x2, y2
        J_q[..., 0, :2] = J_q[..., 3, 2:] = 0.5
        J_q[..., 1, 0], J_q[..., 1, 1] = c1, -c1
        J_q[..., 2, 2], J_q[..., 2, 3] = -c2, c2
        J_H = np.zeros_like(J_q)
        J_H[..., 0, 0] = J_H[..., 0, 2] = J_H[..., 1, 1] = J_H[..., 1, 3] = 0.5
        J_H[..., 2, 0], J_H[..., 2, 1] = 0.25 * at.wx / at.Z, 0.25 * at.wy / at.Z
        PQ_squared = at.wx**2 + at.wy**2
        J_H[..., 3, 0], J_H[..., 3, 1] = at.wy / PQ_squared, -at.wx / PQ_squared
        J_H[..., 2:, 2:] = -J_H[..., 2:, :2]
        return J_H @ J_q

    def singularity_margin(self, q):
        """
        Return by how much (...,) [m] the nearest pivot distance may change before the mechanism is singular.

        Each of the three T-mechanisms is singular when its two pivots coincide or its links lie flat: d3 - d1 and
        d5 - d7 at 0 (3.27) or 2 l2 (3.29), PQ at 2 k10 ((3.28), in any direction) or at 0, where phi is free.
        """
        at = self._linkage(self._joints(q))
        PQ = np.hypot(at.wx, at.wy)
        planar = margins(at.gaps, self.config.geometry.l2).min(axis=-1)
        return np.minimum(planar, margins(PQ, self.config.geometry.k10))

    def passive_angles(self, q):
        """
        Return the angles (...,) [rad] of the links at `q` (..., 4), array or Jet, by name.

        th2, th4, th6, th8: directions of the links from their slider, from +X about +Z. theta10, theta12: elevations
        of the links. phi: turn of the end-effector and of links 9 to 12 about Z.
        """
        at = self._linkage(self._joints(q))
        th2 = np.arctan(2.0 * at.Y1 / at.gaps[..., 0])
        th8 = np.arctan(0.5 * at.gaps[..., 1] / at.X2)
        theta10 = np.arctan(2.0 * at.Z / np.sqrt(at.wx * at.wx + at.wy * at.wy))
        phi = np.arctan(at.wy / at.wx)
        return {
            'th2': th2,
            'th4': np.pi - th2,
            'th6': -th8,
            'th8': th8,
            'theta10': theta10,
            'theta12': theta10,
            'phi': phi,
        }

    def dynamic_parameters(self):
        """Return p as `dynamics.FOUR_DOF_PARAMETERS`; see `Machine.dynamic_parameters`."""
        config = self.config
        numbers = {**dict(config.geometry), **dict(config.masses), **dict(config.inertias)}
        numbers['slender'] = float(config.inertias.rods_about_vertical == 'slender')
        return np.array([numbers[name] for name in self.parameters])

    def _linkage(self, q):
        geometry = self.config.geometry
        gaps = stack([q[..., 1] - q[..., 0], q[..., 2] - q[..., 3]])
        Y1_X2 = heights(gaps, geometry.l2, _GAPS)
        Y1, X2 = Y1_X2[..., 0], Y1_X2[..., 1]
        wx = X2 + geometry.dx - 0.5 * (q[..., 0] + q[..., 1])
        wy = 0.5 * (q[..., 2] + q[..., 3]) - Y1 - geometry.dy
        check_between(value(stack([-wx, wy])), 0.0, 2.0 * geometry.k10, ('x1 - x2', 'y2 - y1'), 'branch (2.15)')
        PQ = np.sqrt(wx * wx + wy * wy)
        Z = heights(stack([PQ]), geometry.k10, ('PQ',), 'length of links 10 and 12 (3.28)')[..., 0]
        return _Linkage(gaps, Y1, X2, wx, wy, Z)
