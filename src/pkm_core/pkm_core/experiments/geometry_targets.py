"""
Targets of a machine with real guides, scales and laser axes: its rest after calibration, by the truth of the plant.

The calibration reads encoders and laser only. The judge alone reads the truth.
"""

import re
from functools import cache

import numpy as np

from pkm_core.design.calibration import LARGEST_MISFIT, calibrate
from pkm_core.design.measurement import load_laser
from pkm_core.design.pose_plan import plan_poses
from pkm_core.design.tolerances import load_tolerances
from pkm_core.errors import PkmError
from pkm_core.experiments.simulated_calibration import simulate_calibration
from pkm_core.machines import load_machine
from pkm_core.machines.checks import ANGLES

ENVIRONMENT = 'geometric'
COUNTS, OTHERS = (20, 60), 50  # poses of the calibration, and of the judge
SPECIMENS = 10  # per noise seed
LIMIT = 0.3  # [um] root mean square in every coordinate


def geometry_tasks(machine, seeds):
    """Return {key: (function, arguments ...)} of the runs of `machine`, one specimen each, for `target_tasks`."""
    return {(machine, 'geometry', seed): (geometry_figures, machine, seed) for seed in range(1, SPECIMENS * seeds + 1)}


def geometry_figures(machine_name, seed):
    """
    Return the figures of one specimen, {number of poses: figures}.

    Figures are root mean square 'before' and 'after', and 'largest' (m,) [m; phi on the arm of the laser], the
    'misfit', and 'lengths': the refusal of a calibration that knows lengths and marks only, '' without one. A refused
    calibration has only 'refused', its text.
    """
    machine = load_machine(machine_name)
    return {count: _figures(machine, seed, count) for count in COUNTS}


def _figures(machine, seed, count):
    laser = load_laser()
    arm = np.array([laser.rotation_arm if name in ANGLES else 1.0 for name in machine.coordinates])
    try:
        done = simulate_calibration(machine, seed, ENVIRONMENT, _plan(machine.name, count), others=OTHERS)
    except PkmError as error:
        return {'refused': str(error)}
    return {
        'before': _rms(done.before * arm),
        'after': _rms(done.after * arm),
        'largest': np.abs(done.after * arm).max(axis=0),
        'misfit': done.calibration.misfit,
        'lengths': _refusal(machine, done.measurements),
    }


@cache
def _plan(machine_name, count):
    """Return the poses of a calibration, one plan for all specimens, as a user would have."""
    return plan_poses(load_machine(machine_name), count, 1, load_tolerances(), load_laser())


def _rms(errors):
    return np.sqrt(np.mean(errors**2, axis=0))


def _refusal(machine, seen):
    try:
        calibrate(machine, seen, load_tolerances(), seen.deviation, geometry='lengths')
    except PkmError as error:
        return str(error)
    return ''


def geometry_rows(name, machine, results):
    """
    Yield (what, goal, reached, met) of the targets of a machine called `name`; `results` are of `geometry_figures`.

    Root mean squares are over specimens and poses; in brackets is that of the worst specimen.
    """
    coordinates = load_machine(machine).coordinates
    texts = []
    for count in COUNTS:
        found = [each[count] for each in results if 'refused' not in each[count]]
        refused = len(results) - len(found)
        texts += [each['lengths'] for each in found]
        before, after = (1e6 * np.array([each[key] for each in found]) for key in ('before', 'after'))
        cells = [
            f'{c} {mean:.2f} ({worst:.2f})'
            for c, mean, worst in zip(coordinates, _rms(after), after.max(axis=0, initial=0.0), strict=False)
        ]
        drawn = ', '.join(f'{value:.1f}' for value in np.atleast_1d(_rms(before)))
        yield (
            f'{name} with real guides, scales and laser axes, at rest, {OTHERS} other poses, calibrated with {count}, '
            f'{len(results)} specimens',
            f'rms <= {LIMIT:g} um, none refused',
            f'{", ".join(cells)} um, {refused} refused; drawing {drawn}' if found else 'all refused',
            not refused and bool((_rms(after) <= LIMIT).all()),
        )
    misfits = [float(found[1]) for found in map(re.compile(r'misfit (\S+) of').search, texts) if found]
    pattern = next((text.partition('; residuals ')[2] for text in texts if text), '')
    yield (
        f'{name} the same, lengths and marks as the only unknowns',
        f'refused, misfit > {LARGEST_MISFIT:g}',
        f'{len(misfits)} of {len(texts)} refused, misfit {min(misfits, default=0.0):.1f} to '
        f'{max(misfits, default=0.0):.1f}; {pattern}',
        len(misfits) == len(texts) > 0,
    )
