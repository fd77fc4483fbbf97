"""Figures 3.1 to 3.9 of the thesis for any four_dof, and the figure of a planar workspace."""

import numpy as np

from pkm_core.design.envelope import clearance, orientation_range
from pkm_core.plotting import new_figure, save

_FROM_ORIGIN = -135.0  # azimuth [deg] of a viewer at the machine's origin


def draw_surfaces(folder, tessellation, surface):
    """Write Fig. 3.1, the hull of the Delaunay tessellation, and Fig. 3.4-3.7, the joined contours from four sides."""
    turns = [(4, 0.0), (5, 90.0), (6, 180.0), (7, 270.0)]
    views = [('fig_3_1', tessellation.surface(), 0.0, '3-D Delaunay tessellation, seen from the origin')]
    views += [(f'fig_3_{n}', surface, turn, f'joined contours, turned {turn:g} deg clockwise') for n, turn in turns]
    for name, mesh, turn, title in views:
        figure = new_figure()
        axes = figure.add_subplot(projection='3d', elev=25.0, azim=_FROM_ORIGIN - turn)
        _draw_mesh(axes, mesh)
        axes.set_title(title)
        save(figure, folder, name)


def _draw_mesh(axes, mesh):
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes.add_collection3d(
        Poly3DCollection(mesh.triangles, facecolors='C0', edgecolors='0.3', linewidths=0.1, shade=True)
    )
    lower, upper = mesh.bounds
    axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), zlim=(lower[2], upper[2]))
    axes.set(xlabel='x [mm]', ylabel='y [mm]', zlabel='z [mm]', box_aspect=(1.0, 1.0, 0.8))  # z is stretched


def draw_grid_table(folder, run, samples=4000):
    """Write Fig. 3.2, samples of the largest slice in its grid table, and Fig. 3.3, its binary image with the edge."""
    slices = run.slices
    number = int(slices.areas().argmax())
    bottom = slices.bottom + number * slices.thickness
    extent = _extent(slices)
    top = bottom + slices.thickness
    title = f'slice {number + 1} of {len(slices.occupied)}, z {1e3 * bottom:.2f} to {1e3 * top:.2f} mm'
    within = run.positions[(run.positions[:, 2] >= bottom) & (run.positions[:, 2] < top)]
    for name in ('fig_3_2', 'fig_3_3'):
        figure = new_figure()
        axes = figure.add_subplot(aspect='equal', xlabel='x [mm]', ylabel='y [mm]')
        if name == 'fig_3_2':
            axes.plot(*(1e3 * within[:samples, :2].T), '.', markersize=2)
            axes.set_xticks(np.arange(extent[0], extent[1], 1e3 * slices.cell), minor=True)
            axes.set_yticks(np.arange(extent[3], extent[2], -1e3 * slices.cell), minor=True)
            axes.grid(which='minor', linewidth=0.3)
            axes.tick_params(which='minor', length=0)
            axes.set_title(f'grid table, {title}')
        else:
            axes.imshow(slices.occupied[number], cmap='gray_r', extent=extent, vmax=1.5)
            axes.plot(*(1e3 * run.contours[number].T), color='C3')
            axes.set_title(f'binary image and its edge, {title}')
        axes.set(xlim=extent[:2], ylim=extent[2:])
        save(figure, folder, name)


def draw_contours(folder, run):
    """Write Fig. 3.8 and 3.9, the contours of all slices from above and from below."""
    from matplotlib import colormaps

    slices = run.slices
    heights = 1e3 * (slices.bottom + slices.thickness * (np.arange(len(run.contours)) + 0.5))
    colours = colormaps['viridis'](np.linspace(0.0, 1.0, len(heights)))
    for name, title, order in (('fig_3_8', 'top', 1), ('fig_3_9', 'bottom', -1)):
        figure = new_figure()
        axes = figure.add_subplot(aspect='equal', xlabel='x [mm]', ylabel='y [mm]')
        for contour, height, colour in list(zip(run.contours, heights, colours, strict=True))[::order]:
            x, y = 1e3 * contour.T
            axes.fill(x, y, facecolor=colour, edgecolor='k', linewidth=0.6, label=f'{height:.1f}')  # the nearest on top
        axes.legend(title='z [mm]', fontsize='x-small', ncols=2, loc='upper right')
        axes.set_title(f'contours from the {title}')
        if order < 0:
            axes.invert_xaxis()  # seen from below
        save(figure, folder, name)


def draw_exact_against_cells(folder, machine, run, shown=4, points=201):
    """Write the contours of `shown` slices with the exact boundary and range of orientations at the same height."""
    slices = run.slices
    left, right, bottom, top = extent = _extent(slices)
    x, y = np.meshgrid(1e-3 * np.linspace(left, right, points), 1e-3 * np.linspace(bottom, top, points))
    figure = new_figure(10.0, 9.0)
    panels = figure.subplots(2, 2)
    numbers = np.linspace(0, len(slices.occupied) - 2, shown).round().astype(int)
    for axes, number in zip(panels.flat, numbers, strict=True):
        z = slices.bottom + (number + 0.5) * slices.thickness
        at = np.stack([x, y, np.full_like(x, z)], axis=-1)
        phi = orientation_range(machine, at)
        width = np.degrees(phi.highest - phi.lowest - phi.gap)
        image = axes.imshow(width, origin='lower', extent=extent, vmin=0.0, vmax=60.0, cmap='Greens')
        axes.contour(1e3 * x, 1e3 * y, clearance(machine, at), levels=[0.0], colors='C3')
        axes.plot(*(1e3 * run.contours[number].T), color='C0', linewidth=0.8)
        axes.set(xlabel='x [mm]', ylabel='y [mm]', title=f'z = {1e3 * z:.2f} mm')
    figure.colorbar(image, ax=panels, label='range of reachable orientations [deg]', shrink=0.6)
    figure.suptitle(f'exact boundary (red) and contour of {1e3 * slices.cell:g} mm cells (blue)')
    save(figure, folder, 'exact_boundary')


def draw_planar(folder, machine, run):
    """Write the workspace of a machine that moves in x and y: its image and contour."""
    figure = new_figure()
    axes = figure.add_subplot(aspect='equal', xlabel='x [mm]', ylabel='y [mm]', title=f'workspace of {machine.name}')
    axes.imshow(run.slices.occupied[0], cmap='gray_r', extent=_extent(run.slices), vmax=1.5)
    axes.plot(*(1e3 * run.contours[0].T), color='C3')
    save(figure, folder, 'workspace')


def _extent(slices):
    """Return (left, right, bottom, top) of the grid [mm]."""
    _, rows, columns = slices.occupied.shape
    return (
        1e3 * slices.left,
        1e3 * (slices.left + columns * slices.cell),
        1e3 * (slices.top - rows * slices.cell),
        1e3 * slices.top,
    )
