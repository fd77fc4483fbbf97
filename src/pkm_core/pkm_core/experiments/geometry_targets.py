"""
Targets of a machine with real guides, scales and laser axes: its rest after calibration, by the truth of the plant.

The calibration reads encoders and laser only. The judge alone reads the truth.
"""

import re
from functools import cache

import numpy as np

from pkm_core.design.calibration import LARGEST_MISFIT, calibrate
from pkm_core.design.measurement import load_laser
from pkm_core.design.pose_plan import plan_poses, spread_poses
from pkm_core.design.tolerances import load_tolerances
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.checks import ANGLES
from pkm_core.simulation.calibration import measure_poses
from pkm_core.simulation.true_rests import true_rests

ENVIRONMENT = 'geometric'
COUNTS, OTHERS = (20, 60), 50  # poses of the calibration, and of the judge
SPECIMENS = 10  # per noise seed
LIMIT = 0.3  # [um] root mean square in every coordinate
_PLAN_SEED, _OTHER_SEED = 1, 2  # one plan for all specimens, as a user would have


def geometry_tasks(machine, seeds):
    """Return {key: (function, arguments ...)} of the runs of `machine`, one specimen each, for `target_tasks`."""
    return {(machine, 'geometry', seed): (geometry_figures, machine, seed) for seed in range(1, SPECIMENS * seeds + 1)}


def geometry_figures(machine_name, seed):
    """
    Return the figures of one specimen.

    Of each number of poses: {'rms', 'largest'} errors (m,) [m; phi on the arm of the laser] and 'misfit', or 'refused',
    the text of a refusal. 'drawing': root mean square error (m,) before. 'lengths': refusal of a calibration that knows
    lengths and marks only, '' if it is not refused.
    """
    machine, laser, tolerances = load_machine(machine_name), load_laser(), load_tolerances()
    arm = np.array([laser.rotation_arm if name in ANGLES else 1.0 for name in machine.coordinates])
    wanted = spread_poses(machine, OTHERS, _OTHER_SEED)

    def errors(sent):
        reached = true_rests(sent, wanted, seed, ENVIRONMENT) - wanted
        return (reached - reached.mean(axis=0)) * arm

    figures: dict = {'drawing': _rms(errors(machine))}
    for count in COUNTS:
        seen = measure_poses(machine, _plan(machine_name, count), laser, seed, ENVIRONMENT)
        if count == COUNTS[0]:
            figures['lengths'] = _refusal(machine, seen, tolerances)
        try:
            found = calibrate(machine, seen, tolerances, seen.deviation)
        except PkmError as error:
            figures[count] = {'refused': str(error)}
            continue
        off = errors(found.machine)
        figures[count] = {'rms': _rms(off), 'largest': np.abs(off).max(axis=0), 'misfit': found.misfit}
    return figures


@cache
def _plan(machine_name, count):
    return plan_poses(load_machine(machine_name), count, _PLAN_SEED, load_tolerances(), load_laser())


def _rms(errors):
    return np.sqrt(np.mean(errors**2, axis=0))


def _refusal(machine, seen, tolerances):
    try:
        calibrate(machine, seen, tolerances, seen.deviation, geometry='lengths')
    except PkmError as error:
        return str(error)
    return ''


def geometry_rows(name, machine, results):
    """
    Yield (what, goal, reached, met) of the targets of a machine called `name`; `results` are of `geometry_figures`.

    Root mean squares are over specimens and poses; in brackets is that of the worst specimen.
    """
    coordinates = load_machine(machine).coordinates
    drawn = ', '.join(f'{value:.1f}' for value in 1e6 * _rms(np.array([each['drawing'] for each in results])))
    for count in COUNTS:
        found = [each[count] for each in results if 'refused' not in each[count]]
        refused = len(results) - len(found)
        rms = 1e6 * np.array([each['rms'] for each in found]).reshape(-1, len(coordinates))
        cells = [
            f'{c} {mean:.2f} ({worst:.2f})'
            for c, mean, worst in zip(coordinates, _rms(rms), rms.max(axis=0, initial=0.0), strict=True)
        ]
        yield (
            f'{name} with real guides, scales and laser axes, at rest, {OTHERS} other poses, calibrated with {count}, '
            f'{len(results)} specimens',
            f'rms <= {LIMIT:g} um, none refused',
            f'{", ".join(cells)} um, {refused} refused; drawing {drawn}',
            not refused and bool((_rms(rms) <= LIMIT).all()),
        )
    texts = [each['lengths'] for each in results]
    misfits = [float(found[1]) for found in map(re.compile(r'misfit (\S+) of').search, texts) if found]
    yield (
        f'{name} the same, lengths and marks as the only unknowns',
        f'refused, misfit > {LARGEST_MISFIT:g}',
        f'{len(misfits)} of {len(texts)} refused, misfit {min(misfits, default=0.0):.1f} to '
        f'{max(misfits, default=0.0):.1f}; {texts[0].partition("; residuals ")[2]}',
        len(misfits) == len(texts),
    )
