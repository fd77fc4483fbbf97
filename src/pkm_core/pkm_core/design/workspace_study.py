"""Results of `pkm workspace`: the Monte-Carlo workspace, the exact workspace, and their differences."""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pkm_core.design.envelope import orientation_range, reached_with
from pkm_core.design.surface import Tessellation, exact_surface, join_contours, tessellate
from pkm_core.design.workspace import Measured, Slices, extremes, measure, pose_volume, sample_poses, slice_positions
from pkm_core.errors import PkmError, WorkspaceError
from pkm_core.thesis.tolerances import WORKSPACE_BOX

_TESSELLATED = 20_000  # samples; more take minutes


@dataclass(frozen=True)
class MonteCarlo:
    """The thesis's method: samples, slices, images, contours."""

    positions: np.ndarray  # (samples, 3) [m]; z = 0 for a planar machine
    slices: Slices
    contours: list  # of (n, 2) [m], one per slice
    seconds: float


def monte_carlo(machine, samples, slice_height, cell, seed):
    """Return the `MonteCarlo` workspace of `machine`; `slice_height` and `cell` in m."""
    start = time.perf_counter()
    poses = sample_poses(machine, samples, seed)
    positions = poses[:, :3] if 'z' in machine.coordinates else np.pad(poses, ((0, 0), (0, 1)))
    slices = slice_positions(positions, slice_height, cell)
    contours = slices.contours()
    return MonteCarlo(positions, slices, contours, time.perf_counter() - start)


def box(machine):
    """Return the corners (3,), (3,) [m] of the bounding box of all positions of a four_dof."""
    ends = extremes(machine)
    return tuple(np.array([ends[name][side].value for name in 'xyz']) for side in (0, 1))


def exact_volume(machine, seed):
    """Return the size `Measured` of all reachable positions: [m^3] of a four_dof, [m^2] of machines in the plane."""
    if machine.config.mechanism == 'layout':
        raise PkmError(f'{machine.name}: surfaces and slices are those of a four_dof; pkm layouts prints the workspace')
    if machine.config.mechanism != 'four_dof':
        return Measured(pose_volume(machine), 0.0)
    return measure(lambda points: np.isfinite(orientation_range(machine, points).lowest), *box(machine), seed)


def volume_with_orientations(machine, lowest, highest, seed):
    """
    Return the volume `Measured` [m^3] where a four_dof reaches every orientation from `lowest` to `highest` [rad].

    Raises
    ------
    WorkspaceError
        If the range is inverted, or no position reaches it.

    """
    volume = measure(lambda points: reached_with(machine, points, lowest, highest), *box(machine), seed)
    if volume.value == 0.0:
        least, most = (np.degrees(end.value) for end in extremes(machine)['phi'])
        raise WorkspaceError(
            f'empty workspace: no position reaches every phi from {np.degrees(lowest):g} to {np.degrees(highest):g} '
            f'deg; the whole workspace of {machine.name} reaches {least:.2f} to {most:.2f} deg'
        )
    return volume


class Volume(NamedTuple):
    """The size of a workspace by one method [m^3, m^2]."""

    value: float
    error: float | None = None  # standard error, None for methods without one
    least: float | None = None  # without the cells at the edge, None for methods without cells


@dataclass(frozen=True)
class SpatialStudy:
    """Volumes and surfaces of the workspace of a four_dof."""

    volumes: dict[str, Volume]  # by method
    tessellation: Tessellation
    joined: object  # trimesh of the joined contours [mm]
    envelope: object  # trimesh of the exact envelope [mm]
    missed: int  # cells with a reached centre but no sample, due to low sample density
    cut: int  # cells with a sample but an unreached centre, cut by the boundary


def study_spatial(machine, run, orientation, dexterous, seed, on_step=lambda name: None):
    """
    Return the `SpatialStudy` of a four_dof and its `MonteCarlo` workspace `run`.

    `orientation` is that of the constant-orientation workspace, `dexterous` the range of the dexterous one [rad].
    `on_step` is called with the name of each step when it begins.
    """
    on_step('closed form: orientations')
    constant, every = (volume_with_orientations(machine, *span, seed) for span in ((orientation,) * 2, dexterous))
    on_step('closed form: reachable')
    exact = exact_volume(machine, seed)
    reached = np.isfinite(orientation_range(machine, run.slices.centres()).lowest)
    on_step('joined contours')
    joined = join_contours(run.slices, run.contours)
    on_step('exact surface')
    envelope = exact_surface(machine, *box(machine))
    on_step('Delaunay tessellation')
    tessellation = tessellate(run.positions[:_TESSELLATED])
    least, most = run.slices.bracket()
    cells, (first, last) = f'{1e3 * run.slices.cell:g} mm cells', np.degrees(dexterous)
    volumes = {
        'exact: closed form': Volume(*exact),
        'exact: surface (marching cubes)': Volume(1e-9 * envelope.volume),
        f'{cells}, occupied': Volume(most, least=least),
        f'{cells}, joined contours': Volume(1e-9 * joined.volume),
        f'Delaunay, {len(tessellation.positions)} points': Volume(tessellation.volume()),
        'Delaunay, circumradius < 0.7 mm': Volume(tessellation.volume(0.7e-3)),
        'Delaunay, circumradius < 1.5 mm': Volume(tessellation.volume(1.5e-3)),
        f'constant orientation {np.degrees(orientation):g} deg': Volume(*constant),
        f'dexterous, {first:g} to {last:g} deg': Volume(*every),
    }
    missed, cut = (int(differ.sum()) for differ in (reached & ~run.slices.occupied, run.slices.occupied & ~reached))
    return SpatialStudy(volumes, tessellation, joined, envelope, missed, cut)


def extreme_figures(machine):
    """Return {coordinate: {...}} of `extremes` in mm and deg."""

    def scaled(name, value):
        return float(np.degrees(value)) if name == 'phi' else 1e3 * value

    return {
        name: {
            'unit': 'deg' if name == 'phi' else 'mm',
            'lowest': scaled(name, lowest.value),
            'highest': scaled(name, highest.value),
            'joints_lowest_mm': (1e3 * lowest.joints).tolist(),
            'joints_highest_mm': (1e3 * highest.joints).tolist(),
        }
        for name, (lowest, highest) in extremes(machine).items()
    }


def box_against_thesis(machine):
    """Return (computed, thesis's) size [mm] of the box in x and y; the latter is None if not in Table 7.5."""
    ends = extremes(machine)
    return tuple(1e3 * (ends[name][1].value - ends[name][0].value) for name in 'xy'), WORKSPACE_BOX.get(machine.name)
