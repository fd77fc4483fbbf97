"""Figure of a calibration: held-out errors before and after, estimates with their uncertainty, identifiability."""

import numpy as np

from pkm_core.design.units import units
from pkm_core.plotting import new_figure, save


def draw_calibration(folder, study, true_errors=None):
    """Write calibration.png of a `CalibrationStudy`; `true_errors` {name: error} [m] are those of a simulation."""
    calibration, machine = study.calibration, study.calibration.machine
    figure = new_figure(12.0, 7.5)
    upper, lower = figure.subfigures(2, 1)
    upper.suptitle('measured minus predicted')
    panels = upper.subplots(1, len(machine.coordinates))
    for i, (axes, (factor, unit)) in enumerate(zip(panels, units(machine), strict=True)):
        axes.plot(factor * study.before[:, i], 'o', color='0.6', markersize=4, label='drawing')
        axes.plot(factor * study.after[:, i], 'o', color='C0', markersize=4, label='calibrated')
        axes.set(xlabel='held-out pose', title=f'{machine.coordinates[i]} [{unit}]')
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize='small')
    left, right = lower.subplots(1, 2, width_ratios=[2, 1])
    names = list(calibration.deviations)
    estimates, deviations = (
        1e6 * np.array([row.get(name, 0.0) for name in names]) for row in (calibration.errors, calibration.deviations)
    )
    left.bar(
        names,
        [2e6 * prior for prior in calibration.priors.values()],
        color='0.92',
        bottom=[-1e6 * prior for prior in calibration.priors.values()],
        label='tolerance',
    )
    left.errorbar(names, estimates, deviations, fmt='o', capsize=3, label='estimate')
    if true_errors:
        left.plot(names, [1e6 * true_errors.get(name, 0.0) for name in names], 'rx', label='true (simulated)')
    left.set(ylabel='deviation from the drawing [um]')
    left.legend(fontsize='small')
    singular = np.maximum(calibration.identifiability.singular_values, 1e-3)
    right.bar(np.arange(1, len(singular) + 1), singular)
    right.axhline(1.0, color='k', linewidth=0.8)
    right.set(yscale='log', xlabel='direction', ylabel='singular value', title='below 1: poorly determined')
    save(figure, folder, 'calibration')
