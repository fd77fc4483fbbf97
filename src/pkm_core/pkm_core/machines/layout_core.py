"""
Kinematics of a layout: two guided pairs carry P and Q, on which a vertical T-mechanism carries the end-effector.

Source: thesis ch. 2, (2.16)-(2.26). The orthogonal layout, the 4-DOF manipulator, has its guides along X and Y; the
parallel one has both along X.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.errors import WorkspaceError
from pkm_core.jet import stack, value
from pkm_core.machines.checks import check_between
from pkm_core.machines.guided_pair import GuidedPair


class LayoutCore(NamedTuple):
    """
    One layout; q = (lower and higher slider of P, lower and higher slider of Q).

    Attributes
    ----------
    p, q : GuidedPair
        The modules of P and of Q.
    k10, dz : float
        Length of links 10 and 12; height of the end-effector over their joint [m].
    heading : float
        Direction from P to Q at home [rad]. phi is that from Q to P, `heading` - pi there, within 90 deg of it.

    """

    p: GuidedPair
    q: GuidedPair
    k10: float
    dz: float
    heading: float

    def forward(self, q):
        """Return the pose (..., 4) at `q` (..., 4) [m], array or Jet; `WorkspaceError` out of reach."""
        x1, y1 = self.p.place(q[..., :2])
        x2, y2 = self.q.place(q[..., 2:])
        wx, wy = x2 - x1, y2 - y1
        c, s = self._axes
        ahead = c * wx + s * wy
        if not (value(ahead) > 0.0).all():
            raise WorkspaceError('PQ: turned by more than 90 deg from home; allowed: less (2.15)')
        square = 0.25 * (wx * wx + wy * wy)
        half = np.sqrt(value(square))[..., None]
        check_between(half, 0.0, self.k10, ('half of PQ',), 'length of links 10 and 12 (3.28)')
        turn = np.arctan((c * wy - s * wx) / ahead)
        Z = np.sqrt(self.k10 * self.k10 - square)
        return stack([0.5 * (x1 + x2), 0.5 * (y1 + y2), Z + self.dz, turn + self._phi_at_home])

    def inverse(self, x):
        """Return the joint positions (..., 4) [m] at the pose `x` (..., 4), array or Jet."""
        check_between(value(x)[..., 2:3], self.dz, self.dz + self.k10, ('z',), 'length of links 10 and 12')
        low, high = self._phi_at_home - 0.5 * np.pi, self._phi_at_home + 0.5 * np.pi
        check_between(value(x)[..., 3:], low, high, ('phi',), 'branch (2.15)')
        Z = x[..., 2] - self.dz
        R = np.sqrt(self.k10 * self.k10 - Z * Z)
        across, along = R * np.cos(x[..., 3]), R * np.sin(x[..., 3])
        at_p = self.p.sliders(x[..., 0] + across, x[..., 1] + along)
        at_q = self.q.sliders(x[..., 0] - across, x[..., 1] - along)
        return stack([*at_p, *at_q])

    def rates(self, q):
        """
        Return (d pose / d sliders (..., 4, 4), d pose / d links (..., 4, 6)) at `q` (..., 4) [m/m; phi: rad/m].

        Links: first and second of P, first and second of Q, 10 on P, 12 on Q.
        """
        P, Q = (np.stack(pair.place(part), axis=-1) for pair, part in ((self.p, q[..., :2]), (self.q, q[..., 2:])))
        w = Q - P
        distance = np.linalg.norm(w, axis=-1)
        Z = np.sqrt(self.k10**2 - 0.25 * distance**2)
        H = np.zeros((*Z.shape, 4, 4))  # of the pose with x1, y1, x2, y2
        H[..., 0, 0] = H[..., 0, 2] = H[..., 1, 1] = H[..., 1, 3] = 0.5
        H[..., 2, :2], H[..., 2, 2:] = (0.25 / Z)[..., None] * w, (-0.25 / Z)[..., None] * w
        turn = np.stack([-w[..., 1], w[..., 0]], axis=-1) / (distance**2)[..., None]
        H[..., 3, :2], H[..., 3, 2:] = -turn, turn
        both = [pair.rates(part) for pair, part in ((self.p, q[..., :2]), (self.q, q[..., 2:]))]
        moves, stretches = (
            np.concatenate([H[..., :2] @ p, H[..., 2:] @ c], axis=-1) for p, c in zip(*both, strict=True)
        )
        rods = np.zeros((*Z.shape, 4, 2))
        shift = (self.k10 / distance**2)[..., None] * w  # of the foot of the end-effector, away from P by link 10
        rods[..., :2, 0], rods[..., :2, 1] = shift, -shift
        rods[..., 2, :] = (0.5 * self.k10 / Z)[..., None]
        return moves, np.concatenate([stretches, rods], axis=-1)

    @property
    def _axes(self):
        return round(float(np.cos(self.heading)), 15), round(float(np.sin(self.heading)), 15)

    @property
    def _phi_at_home(self):
        return self.heading - np.pi
