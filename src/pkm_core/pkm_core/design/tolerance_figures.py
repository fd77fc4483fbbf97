"""Figures 4.3 to 4.7 of the thesis with either error matrix, and the Pareto front."""

import numpy as np

from pkm_core.design.objectives import VARIANTS, squared_norms
from pkm_core.design.optimisation import scan
from pkm_core.plotting import new_figure, save

_MATRIX = {'thesis': "the thesis's matrix", 'true': 'the correct matrix'}


def draw_objectives(folder, workspace, study, arm):
    """Write Fig. 4.3, 4.4, 4.5: f, f1 and f2 over l and k, with the optimum; infeasible designs are blank."""
    poses = workspace.workspace.poses_at_middle_angle()
    scans = {variant: scan(workspace, poses, workspace.bounds, variant, arm) for variant in VARIANTS}
    for number, name in ((3, 'f'), (4, 'f1'), (5, 'f2')):
        figure = new_figure(11.0, 4.6)
        for axes, (variant, found) in zip(figure.subplots(1, 2), scans.items(), strict=True):
            values = getattr(found.objectives, name)
            values = np.log10(np.where(np.isfinite(values), values, np.nan))
            levels = np.nanmin(values) + np.linspace(0.0, 2.0, 41)  # two decades; above: near a singularity
            image = axes.contourf(1e3 * found.l2, 1e3 * found.k10, values, levels=levels, extend='max')
            best = study.objectives[name, variant, 'middle'].optimum
            axes.plot(1e3 * best.l2, 1e3 * best.k10, 'r*', markersize=12, clip_on=False)
            figure.colorbar(image, ax=axes, label=f'log10 {name}')
            title = f'{_MATRIX[variant]}: {best.value:.4g} at l = {1e3 * best.l2:.4g}, k = {1e3 * best.k10:.5g} mm'
            axes.set(xlabel='l [mm]', ylabel='k [mm]', title=title)
            axes.title.set_fontsize('medium')
        save(figure, folder, f'fig_4_{number}')


def draw_norms(folder, workspace, study, arm):
    """Write Fig. 4.6 and 4.7: the sum of squared singular values at every pose of W for the optima of f1 and f2."""
    poses = workspace.workspace.poses()
    for number, name in ((6, 'f1'), (7, 'f2')):
        figure = new_figure(9.0, 4.4)
        axes = figure.subplots()
        for variant in VARIANTS:
            best = study.objectives[name, variant, 'all'].optimum
            values = squared_norms(workspace.geometry(best.l2, best.k10), poses, variant, arm)
            axes.plot(values, '.', markersize=3, label=f'{_MATRIX[variant]}: {values.min():.3f} to {values.max():.3f}')
        axes.set(xlabel='pose of W', ylabel='sum of squared singular values', title=f'at the optimum of {name}')
        axes.legend()
        axes.grid(alpha=0.3)
        save(figure, folder, f'fig_4_{number}')


def draw_pareto(folder, front, machine, design):
    """Write the Pareto front `front` of f1, f2 and size, with the `DesignOnWorkspace` `design` of `machine`."""
    figure = new_figure(7.5, 5.0)
    axes = figure.subplots()
    points = axes.scatter(1e3 * front.size, front.f1, c=front.f2, s=8, cmap='viridis_r', norm='log')
    figure.colorbar(points, ax=axes, label='f2, worst magnification')
    ours = design.values['true']
    axes.plot(1e3 * ours['size'], ours['f1'], 'r*', markersize=12, label=f'{machine.name}, f2 = {ours["f2"]:.3g}')
    axes.set(xlabel='crossing of the guides to the farthest slider [mm]', ylabel='f1, mean magnification', yscale='log')
    axes.set_title('Pareto-optimal designs')
    axes.legend()
    axes.grid(alpha=0.3, which='both')
    save(figure, folder, 'pareto')
