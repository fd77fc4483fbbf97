"""
Geometry of a built machine beyond its lengths: scale errors, guides that are neither straight nor square, laser axes.

It is kinematic only and is stored in the section `built.geometry` of a machine file. Names and signs:

- `scale_d1` ...: a slider moves (1 + scale) times the change of its reading, from the crossing of the guides
- `x_side_k`, `y_side_k`: deviation of a guide from its best line within the plane of the guides, to the left of its
  direction for the X guide and to the right for the Y guide; coefficient of the Legendre polynomial of degree k over
  the travel of the guide [m]
- `x_rise_k`, `y_rise_k`: the same along Z
- `square`: turn of the Y guide with its mechanism about Z, `pitch` about X, `roll` about -Y [rad]
- `height`: the Y guide over the X guide [m]
- `laser_xy` ...: component along y of the direction in which the laser measures x [rad]

The base frame has its X axis along the best line of the X guide and its XY plane in that of the links 2 and 4.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from pkm_core.config import Angle, Config, Length, Number
from pkm_core.jet import Jet, stack

DEGREES = range(2, 8)  # chosen: wavelengths down to a third of the guide; 0 and 1 are its position and direction
GUIDES = {'planar': ('x',), 'four_dof': ('x', 'y')}
_ROUNDS = 10  # of the inverse; with every deviation at its bound each reduces the error 10-fold or more

# chosen: a larger deviation is an error in the file, not of the machine
_Scale = Annotated[Number, Field(ge=-1e-4, le=1e-4)]
_Turn = Annotated[Angle, Field(ge=-5e-4, le=5e-4)]
_Shift = Annotated[Length, Field(ge=-5e-5, le=5e-5)]
_Bow = Annotated[Length, Field(ge=-1e-5, le=1e-5)]


class PlanarRealGeometry(Config):
    """Scale errors of d1, d3; straightness of the guide; axes of the laser (real_geometry.py)."""

    scale_d1: _Scale = 0.0
    scale_d3: _Scale = 0.0
    x_side_2: _Bow = 0.0
    x_side_3: _Bow = 0.0
    x_side_4: _Bow = 0.0
    x_side_5: _Bow = 0.0
    x_side_6: _Bow = 0.0
    x_side_7: _Bow = 0.0
    laser_xy: _Turn = 0.0
    laser_yx: _Turn = 0.0


class FourDofRealGeometry(PlanarRealGeometry):
    """Scale errors, straightness and relative position of both guides, axes of the laser (real_geometry.py)."""

    scale_d5: _Scale = 0.0
    scale_d7: _Scale = 0.0
    x_rise_2: _Bow = 0.0
    x_rise_3: _Bow = 0.0
    x_rise_4: _Bow = 0.0
    x_rise_5: _Bow = 0.0
    x_rise_6: _Bow = 0.0
    x_rise_7: _Bow = 0.0
    y_side_2: _Bow = 0.0
    y_side_3: _Bow = 0.0
    y_side_4: _Bow = 0.0
    y_side_5: _Bow = 0.0
    y_side_6: _Bow = 0.0
    y_side_7: _Bow = 0.0
    y_rise_2: _Bow = 0.0
    y_rise_3: _Bow = 0.0
    y_rise_4: _Bow = 0.0
    y_rise_5: _Bow = 0.0
    y_rise_6: _Bow = 0.0
    y_rise_7: _Bow = 0.0
    square: _Turn = 0.0
    pitch: _Turn = 0.0
    roll: _Turn = 0.0
    height: _Shift = 0.0
    laser_xz: _Turn = 0.0
    laser_yz: _Turn = 0.0
    laser_zx: _Turn = 0.0
    laser_zy: _Turn = 0.0


MODELS: dict[str, type[Config]] = {'planar': PlanarRealGeometry, 'four_dof': FourDofRealGeometry}


def si_unit(name):
    """Return the SI unit of the error `name`, one of this module, or a length or mark; '' for a pure number."""
    kind = name.split('_')[0]
    return '' if kind == 'scale' else 'rad' if kind in ('square', 'pitch', 'roll', 'laser') else 'm'


def printed_unit(name):
    """Return (factor from SI, unit) in which the error `name` is printed."""
    return 1e6, {'': 'ppm', 'rad': 'urad', 'm': 'um'}[si_unit(name)]


def guide_ends(limits, pairs=((0, 1), (3, 2))):
    """Return [(lower, upper)] [m] of the travel along each guide; `pairs` has its lower and its higher slider."""
    return [(limits.lower[low], limits.upper[high]) for low, high in pairs if high < len(limits.lower)]


def end_point(mechanism, sliders, at, ends):
    """
    Return the pose (..., m) [m, rad] of a built machine, array or Jet.

    Parameters
    ----------
    mechanism : str
        'planar' or 'four_dof'.
    sliders : array or Jet, shape (..., n)
        Encoder readings less reference marks [m].
    at : dict
        Length of each link, each offset, belt rotations `psi_p`, `psi_q`, and the deviations named in the module;
        missing deviations are zero. Numbers or arrays that broadcast with (...,).
    ends : list of (float, float)
        As returned by `guide_ends`.

    """
    joints = ('d1', 'd3', 'd5', 'd7')[: sliders.shape[-1]]
    moved = [sliders[..., i] * (1.0 + at.get(f'scale_{joint}', 0.0)) for i, joint in enumerate(joints)]
    along, over, rise = _guide('x', moved[0], moved[1], (at['l2'], at['l4']), at, ends[0])
    turn = at.get('psi_p', 0.0)
    x1, y1 = along - at['dy'] * np.sin(turn), over + at['dy'] * np.cos(turn)
    if mechanism == 'planar':
        return stack([x1, y1])
    along, over, rise_q = _guide('y', moved[3], moved[2], (at['l8'], at['l6']), at, ends[1])
    turn = at.get('psi_q', 0.0)
    along, over = along + at['dx'] * np.sin(turn), over + at['dx'] * np.cos(turn)
    square = at.get('square', 0.0)
    wx = over * np.cos(square) - along * np.sin(square) - x1
    wy = along * np.cos(square) + over * np.sin(square) - y1
    wz = at.get('height', 0.0) + rise_q + at.get('pitch', 0.0) * along + at.get('roll', 0.0) * over - rise
    level = np.sqrt(wx * wx + wy * wy)
    PQ = np.sqrt(level * level + wz * wz)
    foot, Z = _joint(PQ, at['k10'], at['k12'])
    share = (foot - Z * wz / level) / PQ  # the triangle stays in the vertical plane of PQ
    z = rise + (foot * wz + Z * level) / PQ + at['dz']
    return stack([x1 + share * wx, y1 + share * wy, z, np.arctan(wy / wx)])


def laser_axes(coordinates, at):
    """Return the matrix (m, m), or (..., m, m) for arrays in `at`, from a displacement to the laser's reading of it."""
    named = {
        (i, j): at[f'laser_{one}{other}']
        for i, one in enumerate(coordinates)
        for j, other in enumerate(coordinates)
        if f'laser_{one}{other}' in at
    }
    shape = np.broadcast_shapes(*(np.shape(part) for part in named.values()))
    axes = np.broadcast_to(np.eye(len(coordinates)), (*shape, len(coordinates), len(coordinates))).copy()
    for (i, j), part in named.items():
        axes[..., i, j] = part
    return axes


class RealKinematics:
    """
    Kinematics of a machine whose section `built` has a `geometry`.

    Parameters
    ----------
    mechanism : str
    built : PlanarBuilt or FourDofBuilt
    limits : Limits
    closed : (callable, callable)
        Forward and inverse kinematics by lengths and marks alone, in closed form.

    """

    def __init__(self, mechanism, built, limits, closed):
        self._mechanism = mechanism
        self._marks = np.array(list(dict(built.marks).values()))
        self._at = {**built.lengths(), **dict(built.geometry)}
        self._ends = guide_ends(limits)
        self._closed = closed

    def forward(self, q):
        """Return the pose (..., m) at the readings `q` (..., n), array or Jet."""
        return end_point(self._mechanism, q - self._marks, self._at, self._ends)

    def inverse(self, x):
        """
        Return the readings (..., n) at the pose `x` (..., m), array or Jet, to 1e-12 m.

        The difference from the closed form changes slowly with the pose, so the pose is corrected by it and inverted
        again: a Newton iteration with the Jacobian of the lengths.
        """
        forward, back = self._closed
        q = back(x)
        for _ in range(_ROUNDS):
            q = back(x - (self.forward(q) - forward(q)))
        return q

    def jacobian(self, q):
        """Return d forward / dq (..., m, n) at the array `q` (..., n), exact, by Taylor arithmetic."""
        q = np.asarray(q, dtype=float)
        still = np.zeros_like(q)
        columns = [
            self.forward(Jet.from_derivatives(q, np.broadcast_to(step, q.shape), still, still)).derivatives()[1]
            for step in np.eye(q.shape[-1])
        ]
        return np.stack(columns, axis=-1)


def _guide(guide, lower, higher, links, at, ends):
    """Return the joint of two links: along the guide, over it and along Z; from the sliders along the guide."""
    low_side, low_rise = _deviations(guide, lower, at, ends)
    high_side, high_rise = _deviations(guide, higher, at, ends)
    tangent, across = higher - lower, high_side - low_side
    gap = np.sqrt(tangent * tangent + across * across)
    foot, height = _joint(gap, *links)
    along = lower + (foot * tangent - height * across) / gap
    over = low_side + (foot * across + height * tangent) / gap
    return along, over, 0.5 * (low_rise + high_rise)  # joints of equal stiffness share a difference


def _joint(gap, lower, higher):
    """Return (from the lower pivot along the gap, over the gap) of the joint of two links."""
    foot = 0.5 * gap + 0.5 * (lower * lower - higher * higher) / gap
    return foot, np.sqrt(lower * lower - foot * foot)


def _deviations(guide, slider, at, ends):
    """Return the deviations [m] of a guide to the side and along Z at the position `slider` along it."""
    u = (2.0 * slider - (ends[0] + ends[1])) / (ends[1] - ends[0])
    before, polynomial, side, rise = 1.0, u, 0.0, 0.0
    for k in DEGREES:
        before, polynomial = polynomial, ((2 * k - 1) * u * polynomial - (k - 1) * before) / k
        side = side + at.get(f'{guide}_side_{k}', 0.0) * polynomial
        rise = rise + at.get(f'{guide}_rise_{k}', 0.0) * polynomial
    return side, rise
