"""Figure of `pkm experiment drift`."""

import numpy as np

from pkm_core.experiments.drift import MACHINES, MINUTES, RECALIBRATED, RUNS, TIMES
from pkm_core.experiments.drift_report import ERRORS, KINDS, UM, runs_of, worst
from pkm_core.machines import load_machine
from pkm_core.plotting import new_figure, save

_COLORS = {'fixed': 'tab:red', RECALIBRATED: 'black', 'joints': 'tab:blue', 'tool': 'tab:green'}
_SMOOTHED = 9  # cycles, 3 minutes: friction differs from cycle to cycle


def draw_drift(folder, found):
    """Write drift.png for {key: result} of `drift_tasks`: temperatures, drift of home, and error of the move."""
    figure = new_figure(12.0, 6.4)
    for (warm, home, moves), (machine, name) in zip(figure.subplots(len(MACHINES), 3), MACHINES.items(), strict=True):
        runs = runs_of(found, machine)
        _draw_temperatures(warm, runs['fixed'])
        _draw_home(home, runs['fixed'], load_machine(machine).coordinates)
        _draw_errors(moves, runs)
        warm.set(title=f'{name}: temperatures', ylabel='over the room [K]')
        home.set(title=f'{name}: drift of home', ylabel='end point [um]')
        moves.set(title=f'{name}: error of the move', ylabel='worst coordinate [um]', ylim=(0.0, None))
        for axes in (warm, home, moves):
            axes.set(xlabel='production [min]', xlim=(0.0, TIMES[-1] / 60.0))
            axes.grid(alpha=0.3)
            axes.legend(fontsize=7)
    save(figure, folder, 'drift')


def _draw_temperatures(axes, runs):
    mean, nodes = np.mean([run.temperatures for run in runs], axis=0), runs[0].nodes
    for kind in KINDS:
        of_kind = mean[:, [node.startswith(kind) for node in nodes]]
        axes.plot(TIMES / 60.0, of_kind.mean(axis=1), label=f'{kind}s' if of_kind.shape[1] > 1 else kind)


def _draw_home(axes, runs, coordinates):
    true, seen = (UM * np.mean([getattr(run, key) for run in runs], axis=0) for key in ('home', 'laser'))
    for i, coordinate in enumerate(coordinates):
        (line,) = axes.plot(TIMES / 60.0, true[:, i], label='phi on 50 mm' if coordinate == 'phi' else coordinate)
        axes.plot(TIMES / 60.0, seen[:, i], '.', markersize=1.5, color=line.get_color())
    axes.plot([], [], '.', color='grey', label='by laser')


def _draw_errors(axes, runs):
    for run in RUNS:
        mean = UM * worst(np.array([each.error for each in runs[run]])).mean(axis=0)
        ends = np.convolve(np.ones(len(mean)), np.ones(_SMOOTHED), 'same')
        smooth = np.convolve(mean, np.ones(_SMOOTHED), 'same') / ends
        axes.plot(TIMES / 60.0, smooth, color=_COLORS[run], label=ERRORS[run])
    again = UM * worst(np.array([each.error for each in runs[RECALIBRATED]])).mean(axis=(0, 2))
    axes.plot(MINUTES, again, 'x', color=_COLORS[RECALIBRATED], label=ERRORS[RECALIBRATED])
