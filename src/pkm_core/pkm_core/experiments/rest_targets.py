"""Targets of the rest of a calibrated machine at other poses, by the truth of the plant."""

import numpy as np

from pkm_core.experiments.simulated_calibration import OTHERS, POSES, rest_figures
from pkm_core.machines import load_machine

SPECIMENS = 10  # per noise seed
LIMITS = {'nominal': (0.3, 0.6), 'hard': (0.5, 1.0)}  # [um] root mean square, largest


def rest_tasks(machine, seeds):
    """Return {key: (function, arguments ...)} of the runs of `machine`, one specimen each, for `target_tasks`."""
    return {
        (machine, f'rest {environment}', seed): (rest_figures, machine, environment, seed)
        for environment in LIMITS
        for seed in range(1, SPECIMENS * seeds + 1)
    }


def rest_rows(name, machine, found):
    """
    Yield (what, goal, reached, met) of the targets of a machine called `name`; `found` is {'rest nominal': [result]}.

    Figures are those of the worst specimen and pose, and phi is on the arm of the laser. The target holds in every
    coordinate.
    """
    for environment, (most, largest) in LIMITS.items():
        results = found[f'rest {environment}']
        before, after, worst = (
            1e6 * np.array([each[key] for each in results]) for key in ('before', 'after', 'largest')
        )
        rms = np.sqrt(np.mean(after**2, axis=0))
        coordinates = load_machine(machine).coordinates
        cells = [f'{c} {r:.2f} ({w:.2f})' for c, r, w in zip(coordinates, rms, worst.max(axis=0), strict=True)]
        drawn = ', '.join(f'{value:.1f}' for value in np.sqrt(np.mean(before**2, axis=0)))
        yield (
            f'{name} at rest, {OTHERS} other poses, calibrated with {POSES}, {environment}, {len(results)} specimens',
            f'rms <= {most:g} um, largest <= {largest:g}',
            f'{", ".join(cells)} um; drawing {drawn}',
            bool((rms <= most).all() and (worst <= largest).all()),
        )
