"""The figure of `pkm layouts`: the plan of each machine at home, with travel, base area and positions reached."""

import numpy as np

from pkm_core.design.layouts import pairs_of, plan_points
from pkm_core.design.workspace import sample_joints
from pkm_core.machines.kinematic import CORE_ORDER
from pkm_core.machines.layout_core import LayoutCore
from pkm_core.plotting import new_figure, save

_SAMPLES = 4000  # positions drawn


def draw_layouts(folder, machines, found, seed):
    """Draw `machines` with their {name: LayoutFigures} into folder/layouts.png, all to one scale."""
    figure = new_figure(3.3 * len(machines), 4.2)
    panels = np.atleast_1d(figure.subplots(1, len(machines)))
    clouds = {machine.name: 1e3 * plan_points(machine, pairs_of(machine)) for machine in machines}
    half = 0.5 * max(np.ptp(points, axis=0).max() for points in clouds.values()) + 15.0
    for axes, machine in zip(panels, machines, strict=True):
        points = clouds[machine.name]
        low, high = points.min(axis=0), points.max(axis=0)
        _draw_machine(axes, machine, seed)
        axes.add_patch(_rectangle(low, high))
        (x, y), figures = 0.5 * (low + high), found[machine.name]
        axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), aspect='equal', xlabel='x [mm]')
        axes.set_title(f'{figures.title}\nbase {1e4 * figures.area:.0f} cm$^2$', fontsize='medium')
        axes.grid(alpha=0.3)
    panels[0].set_ylabel('y [mm]')
    save(figure, folder, 'layouts')


def _rectangle(low, high):
    from matplotlib.patches import Rectangle

    return Rectangle(low, *(high - low), fill=False, linestyle=':', edgecolor='0.4')


def _draw_machine(axes, machine, seed):
    core = pairs_of(machine)
    spatial = isinstance(core, LayoutCore)
    order, modules = (CORE_ORDER, (core.p, core.q)) if spatial else (np.arange(2), (core,))
    lower, upper, home = (each[order] for each in (machine.limits.lower, machine.limits.upper, machine.home))
    reached = 1e3 * machine.forward(sample_joints(machine, _SAMPLES, seed))[:, :2]
    axes.plot(*reached.T, '.', color='C2', markersize=1.0, alpha=0.5)
    places = []
    for k, module in enumerate(modules):
        part = slice(2 * k, 2 * k + 2)
        pivots, place = module.pivots(home[part]), np.array(module.place(home[part]))
        for i in range(2):
            ends = np.stack([module.pivots(each[part])[i] for each in (lower, upper)])
            axes.plot(*(1e3 * ends.T), color='0.6', linewidth=5.0, solid_capstyle='butt')
            axes.plot(*(1e3 * np.stack([pivots[i], place - module.offset]).T), 'C0-o', linewidth=1.8, markersize=4)
        axes.plot(*(1e3 * np.stack([place - module.offset, place]).T), 'C0-', linewidth=1.0)
        places.append(place)
    if spatial:
        axes.plot(*(1e3 * np.stack(places).T), 'C1-o', linewidth=1.8, markersize=4)
    if getattr(machine.config.geometry, 'bar', False):
        guides = core.origins[:, 1]
        axes.plot(2 * [1e3 * places[0][0]], 1e3 * guides, 'C3-s', linewidth=1.5, markersize=4)
