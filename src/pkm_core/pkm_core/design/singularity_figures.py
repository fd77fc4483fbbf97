"""Maps of determinant and condition number over the workspace of a machine."""

import numpy as np
from scipy.stats import binned_statistic_2d

from pkm_core.design.workspace import extremes
from pkm_core.plotting import new_figure, save


def draw_maps(folder, poses, determinant, condition, length):
    """
    Write maps over x and y of the least abs(det J) and the worst condition number among the samples of each cell.

    `poses` (N, m) are the samples, `determinant` and `condition` (N,) those of the Jacobian at the samples. Angles
    count as arcs on a radius `length` [m].
    """
    figure = new_figure(11.0, 4.6)
    panels = (
        (np.abs(determinant), np.min, r'least $|\det J|$ [SI]', 'viridis'),
        (condition, np.max, f'worst condition number, angles at {1e3 * length:g} mm', 'magma_r'),
    )
    for axes, (values, worst, title, colours) in zip(figure.subplots(1, 2), panels, strict=True):
        found, x, y, _ = binned_statistic_2d(*(1e3 * poses[:, :2].T), values, worst, bins=60)
        image = axes.pcolormesh(x, y, np.log10(found.T), cmap=colours)
        figure.colorbar(image, ax=axes, label='log10')
        axes.set(aspect='equal', xlabel='x [mm]', ylabel='y [mm]', title=title)
    save(figure, folder, 'singularity_map')


def draw_factors(folder, machine):
    """Write det J_q (3.26) over a gap and det J_H (3.25) over PQ of a four_dof, between two singularities."""
    geometry, lower, upper = machine.config.geometry, machine.limits.lower, machine.limits.upper
    figure = new_figure(11.0, 4.2)
    left, right = figure.subplots(1, 2)
    gap = np.linspace(1e-4, 2.0 * geometry.l2 - 1e-4, 400)
    factor = gap / (4.0 * np.sqrt(geometry.l2**2 - 0.25 * gap**2))
    left.semilogy(1e3 * gap, factor)
    left.axvspan(1e3 * (lower[1] - upper[0]), 1e3 * (upper[1] - lower[0]), color='C2', alpha=0.2)
    left.set(xlabel='d3 - d1 [mm]', ylabel='factor of det J_q', title='0 at (3.27), infinite at (3.29)')
    distance = np.linspace(1e-4, 2.0 * geometry.k10 - 1e-4, 400)
    right.semilogy(1e3 * distance, 1.0 / (4.0 * np.sqrt(geometry.k10**2 - 0.25 * distance**2)))
    highest, lowest = (
        2e3 * np.sqrt(geometry.k10**2 - (end.value - geometry.dz) ** 2) for end in extremes(machine)['z']
    )
    right.axvspan(lowest, highest, color='C2', alpha=0.2)
    right.set(xlabel='PQ [mm]', ylabel='abs(det J_H) [1/m]', title='infinite at (3.28)')
    figure.suptitle('shaded: within the travel of the sliders')
    save(figure, folder, 'determinants')
