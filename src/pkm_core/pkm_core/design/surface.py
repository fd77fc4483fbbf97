"""
Closed surfaces of the workspace: joined slice contours, the exact envelope, and the Delaunay tessellation.

All are trimesh meshes in mm, the usual unit of STL and PLY files.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.design.envelope import clearance


def join_contours(slices, contours, points=256):
    """
    Return the surface through the `contours` of `slices`: each resampled to `points`, neighbours joined (thesis ch. 3).

    Top and bottom are closed by a point at the height of the outer slices' faces.
    """
    import trimesh

    rings = np.array([_resample(contour, points) for contour in contours])
    h = len(rings)
    z = slices.bottom + slices.thickness * (np.arange(h) + 0.5)
    walls = np.dstack([rings, np.broadcast_to(z[:, np.newaxis], (h, points))]).reshape(-1, 3)
    tips = [[*rings[0].mean(axis=0), slices.bottom], [*rings[-1].mean(axis=0), slices.bottom + h * slices.thickness]]
    i = np.arange(points)
    j = (i + 1) % points
    bottom, top, last = np.full(points, h * points), np.full(points, h * points + 1), (h - 1) * points
    faces = [np.stack([bottom, j, i], axis=1), np.stack([top, last + i, last + j], axis=1)]
    for low in points * np.arange(h - 1):
        high = low + points
        faces += [np.stack([low + i, low + j, high + j], axis=1), np.stack([low + i, high + j, high + i], axis=1)]
    return trimesh.Trimesh(1e3 * np.vstack([walls, tips]), np.vstack(faces), process=False)


def exact_surface(machine, lower, upper, steps=(64, 64, 32)):
    """
    Return the envelope of a four_dof: the level surface 0 of its clearance, by marching cubes.

    `lower` and `upper` (3,) [m] are the corners of a box around the workspace, `steps` its number of cells.
    """
    import trimesh
    from skimage.measure import marching_cubes

    spacing = np.subtract(upper, lower) / steps
    start = np.subtract(lower, spacing)  # one cell of margin: the surface closes within the grid
    axes = [s + d * np.arange(n + 3) for s, d, n in zip(start, spacing, steps, strict=True)]
    field = clearance(machine, np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1))
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=tuple(1e3 * spacing), gradient_direction='ascent')
    return trimesh.Trimesh(vertices + 1e3 * start, faces)


class Tessellation(NamedTuple):
    """
    Tetrahedra of a 3-D Delaunay tessellation, the thesis's baseline; together they fill the convex hull.

    The tetrahedra up to a chosen circumradius form an alpha shape; its volume depends on that radius.
    """

    positions: np.ndarray  # (N, 3) [m]
    corners: np.ndarray  # (tetrahedra, 4) rows of positions
    volumes: np.ndarray  # (tetrahedra,) [m^3]
    radii: np.ndarray  # (tetrahedra,) of the circumscribed spheres [m]

    def volume(self, radius=np.inf):
        """Return the volume [m^3] of the tetrahedra up to the circumradius `radius` [m]."""
        return float(self.volumes[self.radii <= radius].sum())

    def surface(self, radius=np.inf):
        """Return the mesh of the faces of exactly one tetrahedron among those up to the circumradius `radius` [m]."""
        import trimesh

        kept = self.corners[self.radii <= radius]
        faces = np.sort(kept[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]].reshape(-1, 3), axis=1)
        faces, count = np.unique(faces, axis=0, return_counts=True)
        mesh = trimesh.Trimesh(1e3 * self.positions, faces[count == 1], process=False)
        mesh.fix_normals()
        return mesh


def tessellate(positions):
    """
    Return the `Tessellation` of `positions` (N, 3) [m].

    Examples
    --------
    >>> cube = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    >>> round(tessellate(cube).volume(), 9), tessellate(cube).volume(radius=0.5)
    (1.0, 0.0)

    """
    from scipy.spatial import Delaunay

    positions = np.asarray(positions, dtype=float)
    corners = Delaunay(positions).simplices
    a, b, c, d = np.moveaxis(positions[corners], 1, 0)
    u, v, w = b - a, c - a, d - a
    six_volumes = np.einsum('ij,ij->i', u, np.cross(v, w))
    uu, vv, ww = (np.einsum('ij,ij->i', s, s)[:, np.newaxis] for s in (u, v, w))
    with np.errstate(divide='ignore', invalid='ignore'):  # a flat tetrahedron has no circumscribed sphere
        centres = (uu * np.cross(v, w) + vv * np.cross(w, u) + ww * np.cross(u, v)) / (2.0 * six_volumes[:, np.newaxis])
    radii = np.nan_to_num(np.linalg.norm(centres, axis=1), nan=np.inf, posinf=np.inf)
    return Tessellation(positions, corners, np.abs(six_volumes) / 6.0, radii)


def _resample(contour, points):
    """Return `points` points evenly along the closed `contour` (n, 2), counter-clockwise from its easternmost."""
    ring = contour[:-1]
    x, y = ring.T
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0.0:
        ring = ring[::-1]
    ring = np.roll(ring, -np.argmax(ring[:, 0]), axis=0)
    ring = np.vstack([ring, ring[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    wanted = np.linspace(0.0, along[-1], points, endpoint=False)
    return np.stack([np.interp(wanted, along, ring[:, i]) for i in range(2)], axis=1)
