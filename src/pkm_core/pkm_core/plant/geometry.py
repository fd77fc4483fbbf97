"""
Guides, scales and laser axes of one real machine: the draw, and the true end point, compiled.

The joint positions of the plant remain those that the scales read, so dynamics and controllers do not depend on this
module. Signs are those of machines/real_geometry.py, but not the shapes: here a guide deviates by waves over its
travel, less their best line, and turns are exact.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from pkm_core.machines.assembly import Assembly
from pkm_core.machines.real_geometry import DEGREES

WAVES = 3  # harmonics of the travel
_GUIDES = {'planar': ('x',), 'four_dof': ('x', 'y'), 'xy_stage': ('x', 'y')}
_MECHANISMS = ('planar', 'four_dof', 'xy_stage')  # by their index in _poses
_LINKS = ('l2', 'l4', 'l8', 'l6', 'k10', 'k12')
_OFFSETS = ('dy', 'dx', 'dz')


@dataclass(frozen=True, kw_only=True)
class RealAssembly(Assembly):
    """
    An `Assembly` with the errors of this module.

    Attributes
    ----------
    scale : ndarray, shape (n,)
        Relative excess of the motion of a slider over that of its reading.
    waves : ndarray, shape (2, 2, WAVES + 1, 2)
        By guide (X, Y) and direction (side, along Z): (cosine, sine) of each harmonic, then the (level, slope) of
        their best line [m].
    travel : ndarray, shape (2, 2)
        Lower and upper end of each guide [m].
    turned : ndarray, shape (4,)
        `square`, `pitch`, `roll` [rad] and `height` [m] of the Y guide.

    """

    scale: np.ndarray
    waves: np.ndarray
    travel: np.ndarray
    turned: np.ndarray

    def end_point(self, q, belts):
        """Return the pose (..., m); see `Assembly.end_point`."""
        q, belts = np.asarray(q, dtype=float), np.asarray(belts, dtype=float)
        shape = q.shape[:-1]
        lengths = np.array([self.lengths.get(name, 0.0) for name in _LINKS])
        offsets = np.array([getattr(self.offsets, name, 0.0) for name in _OFFSETS])
        turns = np.zeros((*shape, 2))
        turns[..., : belts.shape[-1]] = belts
        poses = np.empty((*shape, 4 if self.mechanism == 'four_dof' else 2))
        _poses(
            _MECHANISMS.index(self.mechanism),
            np.ascontiguousarray(q * (1.0 + self.scale)).reshape(-1, q.shape[-1]),
            turns.reshape(-1, 2),
            lengths,
            offsets,
            self.waves,
            self.travel,
            self.turned,
            poses.reshape(-1, poses.shape[-1]),
        )
        return poses

    def geometry_errors(self, joints):
        """
        Return {name: error} [m, rad, m/m]; see `Assembly.geometry_errors`.

        The coefficients of a guide are those of its projection on the polynomials; the rest has no name.
        """
        errors = {f'scale_{joint}': float(scale) for joint, scale in zip(joints, self.scale, strict=True)}
        guides = _GUIDES[self.mechanism]
        directions: tuple[str, ...] = ('side',)
        if self.mechanism == 'four_dof':
            directions = ('side', 'rise')
            errors |= dict(zip(('square', 'pitch', 'roll', 'height'), self.turned.tolist(), strict=True))
        u, weights = np.polynomial.legendre.leggauss(32)
        for i, guide in enumerate(guides):
            for j, direction in enumerate(directions):
                s = self.travel[i, 0] + 0.5 * (u + 1.0) * (self.travel[i, 1] - self.travel[i, 0])
                deviations = np.array([_deviation(self.waves[i, j], self.travel[i], slider) for slider in s])
                for k in DEGREES:
                    P = np.polynomial.legendre.Legendre.basis(k)(u)
                    errors[f'{guide}_{direction}_{k}'] = float((k + 0.5) * np.sum(weights * deviations * P))
        axes = np.asarray(self.laser_axes)
        pairs = [(i, j) for i in range(3) for j in range(3) if i != j and max(i, j) < len(axes)]
        return errors | {f'laser_{"xyz"[i]}{"xyz"[j]}': float(axes[i, j]) for i, j in pairs}


def draw_geometry(machine, truth, levels, draw):
    """
    Return the fields that a `RealAssembly` has beyond an `Assembly`, drawn from the generator `draw`.

    `levels` is a truth.GeometryLevels. All numbers are normal. Harmonic k has the deviation straightness / k^2 in
    cosine and sine: long waves prevail on ground guides.
    """
    coordinates, guides = machine.coordinates, _GUIDES[machine.config.mechanism]
    waves, travel = np.zeros((2, 2, WAVES + 1, 2)), np.zeros((2, 2))
    scale = levels.scale * draw.standard_normal(len(machine.joints))
    directions = np.array([axis.direction for axis in truth.axes.values()])
    for guide, name in enumerate(guides):
        on_guide = directions == name
        travel[guide] = machine.limits.lower[on_guide].min(), machine.limits.upper[on_guide].max()
        for direction in range(2):
            amplitudes = levels.straightness / np.arange(1, WAVES + 1)[:, np.newaxis] ** 2
            waves[guide, direction, :WAVES] = amplitudes * draw.standard_normal((WAVES, 2))
            waves[guide, direction, WAVES] = _best_line(waves[guide, direction, :WAVES])
    turned = np.array([levels.square, levels.tilt, levels.tilt, levels.height]) * draw.standard_normal(4)
    if len(guides) == 1:
        turned[:] = 0.0  # no second guide
    axes = np.eye(len(coordinates))
    straight = [i for i, name in enumerate(coordinates) if name in ('x', 'y', 'z')]  # rotations have no direction
    for i in straight:
        for j in straight:
            if i != j:
                axes[i, j] = levels.laser_axes * draw.standard_normal()
    return {'scale': scale, 'waves': waves, 'travel': travel, 'turned': turned, 'laser_axes': axes}


def _best_line(waves):
    """Return (level, slope) over 0..1 of the least-squares line through `waves` (WAVES, 2), in closed form."""
    slope = -np.sum(waves[:, 1] * 6.0 / (np.pi * np.arange(1, len(waves) + 1)))
    return -0.5 * slope, slope


@njit(cache=True, error_model='numpy')
def _deviation(waves, travel, slider):
    """Return the deviation [m] of a guide at `slider`; `waves` (WAVES + 1, 2)."""
    u = (slider - travel[0]) / (travel[1] - travel[0])
    last = waves.shape[0] - 1
    deviation = -waves[last, 0] - waves[last, 1] * u
    for k in range(last):
        angle = 2.0 * np.pi * (k + 1) * u
        deviation += waves[k, 0] * np.cos(angle) + waves[k, 1] * np.sin(angle)
    return deviation


@njit(cache=True, error_model='numpy')
def _joint(ax, ay, bx, by, a, b):
    """Return the intersection, on the left of AB, of the circles about A and B with radii `a` and `b`."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = 0.5 + 0.5 * (a * a - b * b) / square
    over = np.sqrt(a * a / square - share * share)
    return ax + share * dx - over * dy, ay + share * dy + over * dx


@njit(cache=True, error_model='numpy')
def _poses(mechanism, q, turns, lengths, offsets, waves, travel, turned, poses):
    """Fill `poses` (K, m) from sliders `q` (K, n) and belt rotations `turns` (K, 2)."""
    cos, sin, pitch, roll, height = np.cos(turned[0]), np.sin(turned[0]), turned[1], turned[2], turned[3]
    for k in range(q.shape[0]):
        if mechanism == 2:  # the X axis carries the Y axis
            over = _deviation(waves[1, 0], travel[1], q[k, 1])
            poses[k, 0] = q[k, 0] + over * cos - q[k, 1] * sin
            poses[k, 1] = _deviation(waves[0, 0], travel[0], q[k, 0]) + q[k, 1] * cos + over * sin
            continue
        low, high = _deviation(waves[0, 0], travel[0], q[k, 0]), _deviation(waves[0, 0], travel[0], q[k, 1])
        x1, y1 = _joint(q[k, 0], low, q[k, 1], high, lengths[0], lengths[1])
        x1 -= offsets[0] * np.sin(turns[k, 0])
        y1 += offsets[0] * np.cos(turns[k, 0])
        if mechanism == 0:
            poses[k, 0], poses[k, 1] = x1, y1
            continue
        z1 = 0.5 * (_deviation(waves[0, 1], travel[0], q[k, 0]) + _deviation(waves[0, 1], travel[0], q[k, 1]))
        low, high = _deviation(waves[1, 0], travel[1], q[k, 3]), _deviation(waves[1, 0], travel[1], q[k, 2])
        # on the right of the Y guide: the mirror image of the X guide
        along, over = _joint(q[k, 3], low, q[k, 2], high, lengths[2], lengths[3])
        along += offsets[1] * np.sin(turns[k, 1])
        over += offsets[1] * np.cos(turns[k, 1])
        rise = 0.5 * (_deviation(waves[1, 1], travel[1], q[k, 3]) + _deviation(waves[1, 1], travel[1], q[k, 2]))
        wx, wy = over * cos - along * sin - x1, along * cos + over * sin - y1
        wz = height + rise + np.sin(pitch) * along + np.sin(roll) * over - z1
        level = np.sqrt(wx * wx + wy * wy)
        # the vertical triangle, in the plane of PQ and Z
        from_p, up = _joint(0.0, 0.0, level, wz, lengths[4], lengths[5])
        poses[k, 0] = x1 + from_p * wx / level
        poses[k, 1] = y1 + from_p * wy / level
        poses[k, 2] = z1 + up + offsets[2]
        poses[k, 3] = np.arctan(wy / wx)
