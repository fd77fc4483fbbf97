"""
Guided pair: two sliders on straight guides of the plane, one link each, and the joint that both links share.

It is the planar module of every layout of chapter 2: the T-mechanism has both sliders on one guide, the H-linkage on
two parallel guides, the V-linkage on two guides at an angle. The equations are those of two circles around the pivots.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.errors import WorkspaceError
from pkm_core.jet import value
from pkm_core.machines.checks import check_between

SIDES = {'left': 1.0, 'right': -1.0}


class GuidedPair(NamedTuple):
    """
    One module; slider i is at `origins[i]` + d_i `directions[i]`.

    Attributes
    ----------
    origins, directions : ndarray, shape (2, 2)
        Zero of each guide [m], and its unit vector of increasing d.
    links : ndarray, shape (2,)
        Lengths of the links [m].
    side : float
        1.0 if the joint is to the left of the line from the first slider to the second, -1.0 to the right.
    signs : ndarray, shape (2,)
        Sign of each link's projection on the direction of its guide; the branch of the inverse.
    offset : ndarray, shape (2,)
        From the joint to the functional point [m]; the platform does not turn.

    """

    origins: np.ndarray
    directions: np.ndarray
    links: np.ndarray
    side: float
    signs: np.ndarray
    offset: np.ndarray

    def pivots(self, q):
        """Return the pivots (..., 2, 2) [m], sliders then x and y, at `q` (..., 2)."""
        return self.origins + np.asarray(q)[..., None] * self.directions

    def place(self, q):
        """Return the functional point as (x, y) at `q` (..., 2) [m], array or Jet; `WorkspaceError` out of reach."""
        (ox1, oy1), (ox2, oy2) = self.origins
        (ux1, uy1), (ux2, uy2) = self.directions
        l1, l2 = self.links
        ax, ay = ox1 + ux1 * q[..., 0], oy1 + uy1 * q[..., 0]
        gx, gy = ox2 + ux2 * q[..., 1] - ax, oy2 + uy2 * q[..., 1] - ay
        square = gx * gx + gy * gy
        distance = np.sqrt(value(square))[..., None]
        check_between(distance, abs(l1 - l2), l1 + l2, ('distance of the pivots',), 'reach of the links')
        along = 0.5 + 0.5 * (l1 * l1 - l2 * l2) / square
        across = self.side * np.sqrt(l1 * l1 / square - along * along)
        return ax + along * gx - across * gy + self.offset[0], ay + along * gy + across * gx + self.offset[1]

    def sliders(self, x, y):
        """Return (d1, d2) [m] at the functional point `x`, `y` (...,), array or Jet; `WorkspaceError` out of reach."""
        at = []
        jx, jy = x - self.offset[0], y - self.offset[1]
        for origin, (ux, uy), link, sign in zip(self.origins, self.directions, self.links, self.signs, strict=True):
            rx, ry = jx - origin[0], jy - origin[1]
            over = ux * ry - uy * rx
            check_between(value(over)[..., None], -link, link, ('distance from a guide',), 'reach of its link')
            at.append(ux * rx + uy * ry - sign * np.sqrt(link * link - over * over))
        self._check_side(jx, jy, at)
        return tuple(at)

    def _check_side(self, jx, jy, at):
        first, second = (
            origin[:, None] + direction[:, None] * np.ravel(value(d))
            for origin, direction, d in zip(self.origins, self.directions, at, strict=True)
        )
        to_joint = np.stack([np.ravel(value(jx)), np.ravel(value(jy))]) - first
        gap = second - first
        if not (self.side * (gap[0] * to_joint[1] - gap[1] * to_joint[0]) > 0.0).all():
            side = 'left' if self.side > 0.0 else 'right'
            raise WorkspaceError(f'pose: the joint is on the other side of its pivots; allowed: on their {side}')

    def link_directions(self, q):
        """Return the unit vectors (..., 2, 2) from each pivot to the joint at `q` (..., 2)."""
        joint = np.stack(self.place(q), axis=-1) - self.offset
        return (joint[..., None, :] - self.pivots(q)) / self.links[:, None]

    def projections(self, q):
        """Return the projection (..., 2) [m] of each link on the direction of its guide; 0 is singular."""
        return self.links * np.sum(self.link_directions(q) * self.directions, axis=-1)

    def rates(self, q):
        """Return (d point / d sliders, d point / d links), both (..., 2, 2) [m/m], at `q` (..., 2)."""
        n = self.link_directions(q)
        by_links = np.linalg.inv(n)
        return by_links * np.sum(n * self.directions, axis=-1)[..., None, :], by_links

    def margin(self, q):
        """
        Return the distance (...,) [m] from the nearest singularity.

        The links lie flat when the pivots are as far apart as the links are long (3.29). A slider cannot move the joint
        when its link is perpendicular to its guide; the margin is twice the projection, the gap of the sliders (3.27)
        of a T-mechanism.
        """
        pivots = self.pivots(q)
        distance = np.linalg.norm(pivots[..., 1, :] - pivots[..., 0, :], axis=-1)
        return np.minimum(self.links.sum() - distance, 2.0 * np.min(self.signs * self.projections(q), axis=-1))


def guided_pair(origins, directions, link, side, home, offset=0.0):
    """
    Return the `GuidedPair` with two links of length `link` [m] whose branch is that at the joint positions `home` (2,).

    Parameters
    ----------
    origins : array_like, shape (2, 2)
        Zero of each guide [m].
    directions : array_like, shape (2,)
        Angle of each guide from +X about +Z [rad].
    link : float
        Length of both links [m].
    side : str
        'left' or 'right', see `GuidedPair`.
    home : array_like, shape (2,)
        Joint positions [m] with the branch of the inverse.
    offset : float
        From the joint to the functional point, away from the line of the pivots at `home` [m].

    Raises
    ------
    WorkspaceError
        If the links do not reach at `home`.

    Examples
    --------
    >>> pair = guided_pair(np.zeros((2, 2)), [0.0, 0.0], 0.07, 'left', [0.0795, 0.1395], 0.01)
    >>> [round(1e3 * float(each), 4) for each in pair.place(np.array([0.0795, 0.1395]))]  # (2.5), (2.6)
    [109.5, 73.2456]

    """
    unit = np.stack([np.cos(directions), np.sin(directions)], axis=-1).round(15)  # cos 90 deg is 0
    links, turn = np.array([link, link]), SIDES[side]
    bare = GuidedPair(np.asarray(origins, dtype=float), unit, links, turn, np.ones(2), np.zeros(2))
    pivots = bare.pivots(home)
    gap = pivots[1] - pivots[0]
    away = turn * np.array([-gap[1], gap[0]]) / np.linalg.norm(gap)
    signs = np.sign(bare.projections(np.asarray(home, dtype=float)))
    return bare._replace(signs=signs, offset=offset * away)


def check_pair(pair, lower, upper, names):
    """Raise ValueError unless `pair` is regular over the travel from `lower` to `upper` (2,) [m]; a grid of 21 x 21."""
    grid = np.stack(np.meshgrid(*np.linspace(lower, upper, 21).T, indexing='ij'), axis=-1)
    try:
        least = float(pair.margin(grid).min())
    except WorkspaceError as error:
        raise ValueError(f'joints: {names[0]}, {names[1]}: {error}') from None
    if not least > 0.0:
        raise ValueError(
            f'joints: {", ".join(names)}: least distance from a singularity {1e3 * least:.4g} mm; allowed above 0 mm'
        )
