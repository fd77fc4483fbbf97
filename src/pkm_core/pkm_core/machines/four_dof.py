"""
4-DOF parallel manipulator: two planar T-mechanisms on crossed guides carry a vertical one with the end-effector.

Sliders d1, d3 run along X and carry P = (x1, y1); d5, d7 run along Y and carry Q = (x2, y2). Links 10 and 12 connect
P and Q to the end-effector (x, y, z). A belt keeps it level; it turns about Z with PQ by phi.
Source: thesis ch. 2, 3, 5 and Table 6.1. phi is that of (2.19), right-handed about +Z, -45 deg at mid travel; the
printed signs of (2.25), (2.26) belong to -phi.
"""

from typing import Any, NamedTuple

import numpy as np

from pkm_core.jet import stack, value
from pkm_core.machines.base import Compiled, Machine
from pkm_core.machines.built import FourDofBuilt
from pkm_core.machines.checks import check_between
from pkm_core.machines.four_dof_config import FourDofConfig
from pkm_core.machines.real_geometry import RealKinematics
from pkm_core.machines.t_mechanism import joint_place, joint_rates, margins

_GAPS = ('d3 - d1', 'd5 - d7')


class _Linkage(NamedTuple):
    """Internal lengths [m] at a joint position, arrays or Jets (...,)."""

    gaps: Any  # (..., 2): d3 - d1, d5 - d7
    along: Any  # (..., 2): P from d1, Q from d7, along their guides
    over: Any  # (..., 2): P over the X guide without dy, Q over the Y guide without dx
    P: Any  # (..., 2)
    wx: Any  # PQ
    wy: Any
    PQ: Any  # its length
    share: Any  # of PQ, from P to the foot of the end-effector
    Z: Any  # height of the end-effector's joint over P and Q


class FourDof(Machine):
    """The machine of this module; q = [d1, d3, d5, d7], encoder readings of the built machine, x = [x, y, z, phi]."""

    Config = FourDofConfig
    Built = FourDofBuilt
    joints = ('d1', 'd3', 'd5', 'd7')
    coordinates = ('x', 'y', 'z', 'phi')
    parameters = Compiled('FOUR_DOF_PARAMETERS')
    terms = Compiled('four_dof_terms')
    rows = Compiled('four_dof_rows')

    def __init__(self, config, name, configuration=None):
        super().__init__(config, name, configuration)
        built = config.built or FourDofBuilt.as_drawn(config.geometry)
        self._built = built
        self._lower = np.array([built.l2, built.l8])  # links on d1, d7
        self._higher = np.array([built.l4, built.l6])  # links on d3, d5
        self._marks = np.array([getattr(built.marks, joint) for joint in self.joints])
        self._real = None
        if built.geometry is not None:
            self._real = RealKinematics(config.mechanism, built, self.limits, (self._forward, self._inverse))

    def forward(self, q):
        """Return (x, y, z, phi) of (2.5)-(2.8), (2.16)-(2.19) at `q`; see `Machine.forward`."""
        closed = self._forward(q)
        return closed if self._real is None else self._real.forward(self._joints(q))

    def _forward(self, q):
        at = self._linkage(q)
        x, y = at.P[..., 0] + at.share * at.wx, at.P[..., 1] + at.share * at.wy
        return stack([x, y, at.Z + self._built.dz, np.arctan(at.wy / at.wx)])

    def inverse(self, x):
        """Return (d1, d3, d5, d7) of (2.11)-(2.14), (2.20)-(2.26) at the pose `x`; see `Machine.inverse`."""
        x = self._pose(x)
        return self._inverse(x) if self._real is None else self._real.inverse(x)

    def _inverse(self, x):
        built = self._built
        dx, dy, dz = built.dx, built.dy, built.dz
        # z below dz and phi outside the range are other assembly modes, which no motion of the sliders reaches
        highest = dz + min(built.k10, built.k12)
        check_between(value(x)[..., 2:3], dz, highest, ('z',), 'length of links 10 and 12')
        check_between(value(x)[..., 3:], -0.5 * np.pi, 0.0, ('phi',), 'branch (2.15)')
        Z, phi = x[..., 2] - dz, x[..., 3]
        # horizontal parts of links 10 and 12; with equal links each is half of PQ
        R10, R12 = np.sqrt(built.k10 * built.k10 - Z * Z), np.sqrt(built.k12 * built.k12 - Z * Z)
        cos, sin = np.cos(phi), np.sin(phi)
        x1, y1 = x[..., 0] + R10 * cos, x[..., 1] + R10 * sin
        x2, y2 = x[..., 0] - R12 * cos, x[..., 1] - R12 * sin
        l24, l68 = min(built.l2, built.l4), min(built.l6, built.l8)
        check_between(value(y1)[..., None], dy, dy + l24, ('y1',), 'reach of links 2 and 4 (2.10)')
        check_between(value(x2)[..., None], dx, dx + l68, ('x2',), 'reach of links 6 and 8 (2.10)')
        over = stack([y1 - dy, x2 - dx])
        below, above = (np.sqrt(link * link - over * over) for link in (self._lower, self._higher))
        return stack([x1 - below[..., 0], x1 + above[..., 0], y2 + above[..., 1], y2 - below[..., 1]]) + self._marks

    def jacobian(self, q):
        """Return J = J_H J_q (..., 4, 4) [m/m; phi: rad/m] of (3.16)-(3.21); see `Machine.jacobian`."""
        if self._real is not None:
            self._forward(q)  # raises out of reach
            return self._real.jacobian(q)
        at = self._linkage(q)
        moves, sinks = joint_rates(at.gaps, at.along, at.over)
        J_q = np.zeros((*at.Z.shape, 4, 4))  # rows x1, y1, x2, y2
        J_q[..., 0, 0], J_q[..., 0, 1] = 1.0 - moves[..., 0], moves[..., 0]
        J_q[..., 1, 0], J_q[..., 1, 1] = -sinks[..., 0], sinks[..., 0]
        J_q[..., 2, 2], J_q[..., 2, 3] = sinks[..., 1], -sinks[..., 1]
        J_q[..., 3, 2], J_q[..., 3, 3] = moves[..., 1], 1.0 - moves[..., 1]
        J_H = np.zeros_like(J_q)
        along = at.share * at.PQ
        _, sinks = joint_rates(at.PQ, along, at.Z)
        sinks, bends = sinks / at.PQ, (1.0 - 2.0 * at.share) / at.PQ**2  # bends: 0 if links 10 and 12 are equal
        J_H[..., 0, 2], J_H[..., 0, 3] = at.share + bends * at.wx**2, bends * at.wx * at.wy
        J_H[..., 1, 2], J_H[..., 1, 3] = bends * at.wx * at.wy, at.share + bends * at.wy**2
        J_H[..., 2, 2], J_H[..., 2, 3] = sinks * at.wx, sinks * at.wy
        J_H[..., 3, 2], J_H[..., 3, 3] = -at.wy / at.PQ**2, at.wx / at.PQ**2
        J_H[..., :2] = -J_H[..., 2:]
        J_H[..., 0, 0] += 1.0  # the same motion of P and Q moves the end-effector as well
        J_H[..., 1, 1] += 1.0
        return J_H @ J_q

    def singularity_margin(self, q):
        """
        Return the change (...,) [m] of a pivot distance after which the mechanism is singular, the least of all three.

        Each of the three T-mechanisms is singular when its two pivots coincide or its links lie flat: d3 - d1 and
        d5 - d7 at 0 (3.27) or 2 l2 (3.29), PQ at 2 k10 ((3.28), in any direction) or at 0, where phi is free.
        """
        at = self._linkage(q)
        planar = margins(at.gaps, self._lower, self._higher).min(axis=-1)
        return np.minimum(planar, margins(at.PQ, self._built.k10, self._built.k12))

    def passive_angles(self, q):
        """
        Return the angles (...,) [rad] of the links at `q` (..., 4), array or Jet, by name.

        th2, th4, th6, th8: directions of the links from their slider, from +X about +Z. theta10, theta12: elevations
        of the links. phi: turn of the end-effector and of links 9 to 12 about Z.
        """
        at = self._linkage(q)
        beyond = at.gaps - at.along
        along = at.share * at.PQ
        return {
            'th2': np.arctan(at.over[..., 0] / at.along[..., 0]),
            'th4': np.pi - np.arctan(at.over[..., 0] / beyond[..., 0]),
            'th6': -np.arctan(beyond[..., 1] / at.over[..., 1]),
            'th8': np.arctan(at.along[..., 1] / at.over[..., 1]),
            'theta10': np.arctan(at.Z / along),
            'theta12': np.arctan(at.Z / (at.PQ - along)),
            'phi': np.arctan(at.wy / at.wx),
        }

    def dynamic_parameters(self):
        """Return p as `dynamics.FOUR_DOF_PARAMETERS`; see `Machine.dynamic_parameters`."""
        config = self.config
        numbers = {**dict(config.geometry), **dict(config.masses), **dict(config.inertias)}
        numbers['slender'] = float(config.inertias.rods_about_vertical == 'slender')
        return np.array([numbers[name] for name in self.parameters])

    def _linkage(self, q):
        built = self._built
        q = self._joints(q) - self._marks
        gaps = stack([q[..., 1] - q[..., 0], q[..., 2] - q[..., 3]])
        along, over = joint_place(gaps, self._lower, self._higher, _GAPS)
        P = stack([q[..., 0] + along[..., 0], over[..., 0] + built.dy])
        wx = over[..., 1] + built.dx - P[..., 0]
        wy = q[..., 3] + along[..., 1] - P[..., 1]
        check_between(value(stack([-wx, wy])), 0.0, built.k10 + built.k12, ('x1 - x2', 'y2 - y1'), 'branch (2.15)')
        PQ = np.sqrt(wx * wx + wy * wy)
        foot, Z = joint_place(PQ[..., None], built.k10, built.k12, ('PQ',), 'length of links 10 and 12 (3.28)')
        return _Linkage(gaps, along, over, P, wx, wy, PQ, foot[..., 0] / PQ, Z[..., 0])
