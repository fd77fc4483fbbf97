"""
The workspace by Monte-Carlo simulation and slicing, (3.30)-(3.32), and its exact extremes and volume.

Samples of the joints are mapped to poses, cut into slices parallel to the xy-plane and counted in a grid table: one
binary image per slice. A cell with a sample counts fully, so the cells overestimate the workspace (`Slices.bracket`).
`measure` and `pose_volume` have no such bias.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pkm_core.errors import WorkspaceError


def sample_joints(machine, samples, seed):
    """Return joint positions (samples, n) [m] drawn uniformly within the travel of `machine`."""
    lower, upper = machine.limits.lower, machine.limits.upper
    return lower + (upper - lower) * np.random.default_rng(seed).random((samples, len(lower)))


def sample_poses(machine, samples, seed):
    """Return the poses (samples, m) of `machine` at `sample_joints`."""
    return machine.forward(sample_joints(machine, samples, seed))


class Extreme(NamedTuple):
    """The lowest or highest value of one coordinate within the travel."""

    value: float  # [m] or [rad]
    joints: np.ndarray  # (n,) joint positions of the value [m]


def extremes(machine):
    """
    Return {coordinate: (lowest, highest)}, each an `Extreme`: the best of a grid over the travel, refined by L-BFGS-B.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> [round(1e3 * end.value, 3) for end in extremes(load_machine('planar'))['y']]
    [58.99, 79.282]

    """
    from scipy.optimize import minimize

    lower, upper = machine.limits.lower, machine.limits.upper
    grid = np.stack(np.meshgrid(*np.linspace(lower, upper, 5).T, indexing='ij'), axis=-1).reshape(-1, len(lower))
    poses = machine.forward(grid)

    def end(i, sign):
        best = minimize(
            lambda q: 1e3 * sign * machine.forward(q)[i],  # mm: the tolerances of the search are absolute
            grid[np.argmin(sign * poses[:, i])],
            jac=lambda q: 1e3 * sign * machine.jacobian(q)[i],
            bounds=np.stack([lower, upper], axis=1),
            method='L-BFGS-B',
            options={'ftol': 1e-15, 'gtol': 1e-10},
        )
        return Extreme(float(machine.forward(best.x)[i]), best.x)

    return {name: (end(i, 1.0), end(i, -1.0)) for i, name in enumerate(machine.coordinates)}


def pose_volume(machine, nodes=16):
    """
    Return the volume of all poses of `machine` [product of the units of its coordinates], the integral of abs(det J).

    The map between poses and joint positions of one assembly is one-to-one, so no pose is counted twice.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> round(1e6 * pose_volume(load_machine('planar')), 4)
    392.0938

    """
    node, weight = np.polynomial.legendre.leggauss(nodes)
    lower, upper = machine.limits.lower, machine.limits.upper
    half = 0.5 * (upper - lower)
    axes = [middle + width * node for middle, width in zip(0.5 * (lower + upper), half, strict=True)]
    q = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1)
    weights = np.prod(np.stack(np.meshgrid(*([weight] * len(axes)), indexing='ij'), axis=-1), axis=-1)
    return float(np.prod(half) * (weights * np.abs(np.linalg.det(machine.jacobian(q)))).sum())


class Measured(NamedTuple):
    """A volume or area with its standard error [m^3, m^2]."""

    value: float
    error: float


def measure(inside, lower, upper, seed, points=1 << 16, repeats=8):
    """
    Return the volume of the set `inside` in the box from `lower` to `upper`, a `Measured`.

    Parameters
    ----------
    inside : callable
        Takes points (N, d), returns for each whether it belongs to the set, or any density (N,).
    lower, upper : sequence of d floats
        Corners of the box.
    seed : int
        Seed of the scrambled Sobol sequences.
    points, repeats : int
        Points per sequence, and number of sequences; the error is computed from their scatter.

    Examples
    --------
    >>> round(measure(lambda p: np.hypot(*p.T) < 1.0, (0.0, 0.0), (1.0, 1.0), seed=1).value, 3)
    0.785

    """
    from scipy.stats import qmc

    sides = np.subtract(upper, lower)
    found = []
    for child in np.random.SeedSequence(seed).spawn(repeats):
        sobol = qmc.Sobol(len(sides), rng=np.random.default_rng(child))
        found.append(np.prod(sides) * np.mean(inside(lower + sides * sobol.random(points))))
    return Measured(float(np.mean(found)), float(np.std(found, ddof=1) / np.sqrt(repeats)))


@dataclass(frozen=True)
class Slices:
    """
    Samples in one grid table per slice, (3.30)-(3.32); all slices have the same grid.

    Attributes
    ----------
    bottom, thickness : float
        z of the underside of slice 0, thickness of each [m].
    left, top : float
        x of the left edge of column 0, y of the upper edge of row 0 [m].
    cell : float
        Side of a cell [m].
    occupied : ndarray of bool, shape (slices, rows, columns)
        Whether a cell holds a sample.

    """

    bottom: float
    thickness: float
    left: float
    top: float
    cell: float
    occupied: np.ndarray

    def volume(self):
        """Return the volume of all occupied cells [m^3]."""
        return self.occupied.sum() * self.cell**2 * self.thickness

    def areas(self):
        """Return the area (slices,) of each slice's occupied cells [m^2]."""
        return self.occupied.sum(axis=(1, 2)) * self.cell**2

    def projected_area(self):
        """Return the area of the cells occupied in any slice [m^2]."""
        return self.occupied.any(axis=0).sum() * self.cell**2

    def bracket(self):
        """Return (least, most) volume [m^3]: of the cells with only occupied neighbours, and of all occupied cells."""
        from scipy.ndimage import binary_erosion

        return binary_erosion(self.occupied).sum() * self.cell**2 * self.thickness, self.volume()

    def centres(self):
        """Return the centres (slices, rows, columns, 3) of all cells [m]."""
        h, rows, columns = self.occupied.shape
        z = self.bottom + self.thickness * (np.arange(h) + 0.5)
        y = self.top - self.cell * (np.arange(rows) + 0.5)
        x = self.left + self.cell * (np.arange(columns) + 0.5)
        z, y, x = np.meshgrid(z, y, x, indexing='ij')
        return np.stack([x, y, z], axis=-1)

    def contours(self):
        """
        Return one closed contour (n, 2) [m] in x, y per slice: the edge of its binary image.

        It is the longest contour found by marching squares; holes and separate parts of a slice are omitted.
        """
        from skimage.measure import find_contours

        found = []
        for image in self.occupied:
            rows, columns = max(find_contours(np.pad(image, 1).astype(float), 0.5), key=len).T - 0.5
            found.append(np.stack([self.left + self.cell * columns, self.top - self.cell * rows], axis=1))
        return found


def slice_positions(positions, slice_height, cell):
    """
    Return the `Slices` of `positions` (N, 3) [m], about `slice_height` thick, on a grid of `cell` [m].

    Source: (3.30) for the number of slices, (3.31) and (3.32) for column and row.

    Examples
    --------
    >>> corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    >>> slice_positions(corners, slice_height=0.5, cell=0.6).occupied.astype(int)
    array([[[0, 0],
            [1, 1]],
    <BLANKLINE>
           [[0, 1],
            [0, 0]]])

    """
    positions = np.asarray(positions, dtype=float)
    for name, size in (('slice height', slice_height), ('cell', cell)):
        if not 0.0 < size < np.inf:
            raise WorkspaceError(f'{name} {1e3 * size:g} mm; allowed above 0 mm')
    if len(positions) == 0 or not np.isfinite(positions).all():
        raise WorkspaceError(f'{len(positions)} positions given; expected at least one, all finite')
    (left, _, bottom), (_, top, highest) = positions.min(axis=0), positions.max(axis=0)
    h = max(1, round((highest - bottom) / slice_height))
    thickness = (highest - bottom) / h or slice_height
    number = np.minimum(((positions[:, 2] - bottom) / thickness).astype(int), h - 1)  # the highest in the last slice
    column = ((positions[:, 0] - left) / cell).astype(int)
    row = ((top - positions[:, 1]) / cell).astype(int)
    shape = (h, row.max() + 1, column.max() + 1)
    if np.prod(shape) > 1e9:
        raise WorkspaceError(f'{" x ".join(map(str, shape))} cells; allowed up to 1e9: choose larger cells')
    occupied = np.zeros(shape, dtype=bool)
    occupied[number, row, column] = True
    return Slices(bottom, thickness, left, top, cell, occupied)
