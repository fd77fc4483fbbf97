"""Cartesian paths of one move: pose of the end point at the share s of the path."""

import numpy as np

from pkm_core.errors import TrajectoryError
from pkm_core.jet import stack


class Line:
    """Straight line in all coordinates, angles included."""

    def __init__(self, start, end, lengths):
        self._start, self._change = start, end - start
        self.length = float(np.linalg.norm(self._change[lengths]))

    def at(self, s):
        """Return the pose (..., m) at the share `s`, an array or a Jet of shape (...,)."""
        return stack([start + change * s for start, change in zip(self._start, self._change, strict=True)])


class Arc:
    """
    Circle through three points; coordinates that are not lengths (phi) change in proportion to the path.

    Parameters
    ----------
    start, end : ndarray, shape (m,)
        Poses [m, rad].
    via : ndarray, shape (k,)
        A point between them, lengths only [m].
    lengths : list of int
        Indices of the k coordinates that are lengths.

    """

    def __init__(self, start, via, end, lengths):
        points = np.zeros((3, 3))  # a planar machine has no z
        points[:, : len(lengths)] = start[lengths], via, end[lengths]
        a, b = points[1] - points[0], points[2] - points[0]
        n = np.cross(a, b)
        square = n @ n
        if square <= 1e-12 * (a @ a) * (b @ b):
            raise TrajectoryError('start, via and end of the arc lie on one line; expected three points of a circle')
        self._centre = points[0] + (np.cross(n, a) * (b @ b) + np.cross(b, n) * (a @ a)) / (2 * square)
        self._cosine = points[0] - self._centre
        self._sine = np.cross(n, self._cosine) / np.sqrt(square)
        chord = points[2] - self._centre
        self._angle = np.mod(np.arctan2(chord @ self._sine, chord @ self._cosine), 2 * np.pi)
        self.length = float(np.linalg.norm(self._cosine) * self._angle)
        self._lengths, self._line = lengths, Line(start, end, lengths)

    def at(self, s):
        """Return the pose (..., m) at the share `s`, an array or a Jet of shape (...,)."""
        pose, turn = self._line.at(s), s * self._angle
        circle = zip(self._centre, self._cosine, self._sine, strict=True)
        points = [centre + cosine * np.cos(turn) + sine * np.sin(turn) for centre, cosine, sine in circle]
        columns = [pose[..., i] for i in range(pose.shape[-1])]
        for column, point in zip(self._lengths, points, strict=False):
            columns[column] = point
        return stack(columns)
