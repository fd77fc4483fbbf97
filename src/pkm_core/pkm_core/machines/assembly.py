"""
One built specimen of a machine: true link lengths, reference marks, payload, and the true position of its end point.

Lengths enter the kinematics only. In the dynamics 10 um on 70 mm would change masses by 1e-4, far below the gain error.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np


def _pivot(lower, higher, l_lower, l_higher):
    """Return (along the guide, height over it) of the joint of two links on sliders at `lower` and `higher`."""
    from_lower = 0.5 * (higher - lower) + (l_lower**2 - l_higher**2) / (2.0 * (higher - lower))
    return lower + from_lower, np.sqrt(l_lower**2 - from_lower**2)


@dataclass(frozen=True)
class Assembly:
    """
    Properties of one built machine.

    Attributes
    ----------
    mechanism : str
        As in the machine's file.
    offsets : object
        The nominal dx, dy, dz [m], attributes of the machine's geometry; None if the machine has none.
    lengths : dict
        True length of each link [m].
    encoder_offset : ndarray, shape (n,)
        Reading minus joint position, without noise and rounding [m].
    payload : float
        [kg].
    laser_axes : ndarray, shape (m, m), optional
        From a displacement of the end point to the laser's reading of it; None: the laser has the machine's axes.
    scale : ndarray, shape (n,), optional
        Relative excess of the motion of a slider over that of its reading; None: scales without error.

    """

    mechanism: str
    offsets: Any
    lengths: dict
    encoder_offset: np.ndarray
    payload: float
    laser_axes: np.ndarray | None = None
    scale: np.ndarray | None = None

    def end_point(self, q, belts):
        """
        Return the pose (..., m) at true joint positions `q` (..., n) [m], belt rotations `belts` (..., 2 or 0) [rad].

        Equal to `Machine.forward` for nominal links and stiff belts. Source: (2.5)-(2.19), with the intersection of
        circles of unequal links; belts as in plant/belts.py.
        """
        if self.mechanism == 'xy_stage':
            return np.array(q)
        at, lengths = self.offsets, self.lengths
        q = q if self.scale is None else q * (1.0 + self.scale)
        psi_p, psi_q = (belts[..., 0], belts[..., 1]) if belts.shape[-1] else (0.0, 0.0)
        x1, y1 = _pivot(q[..., 0], q[..., 1], lengths['l2'], lengths['l4'])
        x1, y1 = x1 - at.dy * np.sin(psi_p), y1 + at.dy * np.cos(psi_p)
        if self.mechanism == 'planar':
            return np.stack([x1, y1], axis=-1)
        y2, x2 = _pivot(q[..., 3], q[..., 2], lengths['l8'], lengths['l6'])
        x2, y2 = x2 + at.dx * np.cos(psi_q), y2 + at.dx * np.sin(psi_q)
        distance = np.hypot(x2 - x1, y2 - y1)
        # the vertical triangle: from_p along PQ, height over P and Q
        from_p, height = _pivot(0.0, distance, lengths['k10'], lengths['k12'])
        share = from_p / distance
        return np.stack(
            [x1 + share * (x2 - x1), y1 + share * (y2 - y1), height + at.dz, np.arctan((y2 - y1) / (x2 - x1))], axis=-1
        )

    def geometry_errors(self, joints):
        """Return {name: error} of guides, scales and laser axes, names as in real_geometry.py; here there are none."""
        return {}
