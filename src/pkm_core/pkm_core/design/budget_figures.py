"""Figures of an error budget: distribution, contributions, map over the workspace."""

import numpy as np
from scipy.stats import binned_statistic_2d

from pkm_core.design.budget import linear_budget
from pkm_core.design.units import units
from pkm_core.design.workspace import sample_joints
from pkm_core.plotting import new_figure, save


def draw_distribution(folder, machine, budget, found):
    """Write the histograms of a `Distribution` with the normal mixture predicted by the `LinearBudget`."""
    names = machine.coordinates
    figure = new_figure(3.4 * len(names), 3.6)
    for i, (axes, (factor, unit)) in enumerate(zip(figure.subplots(1, len(names)), units(machine), strict=True)):
        edges = factor * found.edges[:, i]
        coarse = found.counts[:, i].reshape(-1, 20).sum(axis=1)  # 200 bins over the span
        axes.stairs(
            coarse / coarse.sum() / (edges[20] - edges[0]), edges[::20], fill=True, alpha=0.5, label='simulated'
        )
        deviations = factor * budget.total()[:, i]
        x = np.linspace(-4.0, 4.0, 201) * deviations.max()
        density = np.exp(-0.5 * (x[:, np.newaxis] / deviations) ** 2) / (np.sqrt(2.0 * np.pi) * deviations)
        axes.plot(x, density.mean(axis=1), 'k', linewidth=1.0, label='linear')
        axes.set(xlim=(x[0], x[-1]), xlabel=f'error of {names[i]} [{unit}]', yticks=[])
    axes.legend()
    figure.suptitle(f'{found.machines} machines at {len(found.mean)} poses')
    save(figure, folder, 'budget_distribution')


def draw_contributions(folder, machine, budget):
    """Write a bar chart of the standard deviation due to each source alone, largest on top."""
    rows = budget.source_deviations()
    figure = new_figure(3.2 * len(machine.coordinates), 0.28 * len(rows) + 1.0)
    panels = figure.subplots(1, len(machine.coordinates), sharey=True)
    for i, (axes, (factor, unit)) in enumerate(zip(panels, units(machine), strict=True)):
        axes.barh(list(rows), [factor * row[i] for row in rows.values()])
        axes.set(xlabel=f'{machine.coordinates[i]}: standard deviation [{unit}]')
        axes.grid(axis='x', alpha=0.3)
    panels[0].invert_yaxis()
    save(figure, folder, 'budget_contributions')


def draw_map(folder, machine, tolerances, seed, geometry=False, samples=20_000):
    """Write the linear standard deviation over x and y, the mean over the samples of each cell."""
    q = sample_joints(machine, samples, seed)
    deviations = linear_budget(machine, tolerances, q, geometry).total()
    x, y = 1e3 * machine.forward(q)[:, :2].T
    figure = new_figure(4.0 * len(machine.coordinates), 3.6)
    panels = figure.subplots(1, len(machine.coordinates))
    for i, (axes, (factor, unit)) in enumerate(zip(panels, units(machine), strict=True)):
        found, x_edges, y_edges, _ = binned_statistic_2d(x, y, factor * deviations[:, i], 'mean', bins=40)
        image = axes.pcolormesh(x_edges, y_edges, found.T)
        figure.colorbar(image, ax=axes, label=f'[{unit}]')
        axes.set(
            aspect='equal', xlabel='x [mm]', ylabel='y [mm]', title=f'standard deviation of {machine.coordinates[i]}'
        )
    save(figure, folder, 'budget_map')
