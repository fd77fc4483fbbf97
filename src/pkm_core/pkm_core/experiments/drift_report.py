"""Tables of `pkm experiment drift`."""

import numpy as np

from pkm_core.experiments.drift import ENVIRONMENT, MACHINES, MINUTES, MOVE_TIME, RECALIBRATED, RUNS, per_kelvin, window
from pkm_core.experiments.outcome import spread
from pkm_core.machines import load_machine
from pkm_core.machines.checks import ANGLES
from pkm_core.reporting.histories import ARM
from pkm_core.reporting.tables import Table

UM = 1e6
KINDS = ('motor', 'link', 'scale', 'platform')
ERRORS = {
    'fixed': 'nothing learns',
    'joints': 'joints learn',
    RECALIBRATED: 'recalibrated',
    'tool': 'tool learns',
}


def drift_report(found, seeds, cycles):
    """Return ([`Table`], figures as a nested dict) for {key: result} of `drift_tasks`."""
    tables, data = [_per_kelvin_table()], {}
    for machine, name in MACHINES.items():
        runs = runs_of(found, machine)
        coordinates = load_machine(machine).coordinates
        homes, errors, rests = ([], [], [])
        rows: list = []
        for i, minute in enumerate(MINUTES):
            row = _row(runs, i, window(minute, cycles), coordinates)
            rows.append({'minute': minute, **row})
            warm, home = row['temperature_K'], row['home_um']
            kinds = [f'{warm[kind]:.1f}' for kind in KINDS]
            homes.append([str(minute), *kinds, *(f'{value:.1f}' for value in home.values()), _cell(row['unseen_um'])])
            errors.append([str(minute), *(_cell(row['error_um'][run]) for run in ERRORS)])
            rests.append(
                [str(minute), *(f'{row[key][c]:.2f}' for c in coordinates for key in ('rest_cold_um', 'rest_new_um'))]
            )
        what = f'{name}, {ENVIRONMENT}, moves of {1e3 * MOVE_TIME:g} ms without pause, specimens 1 to {seeds}'
        counted = f'{cycles} cycles from then on'
        axes = [f'{c} [um]' for c in coordinates]
        tables += [
            Table(
                f'{what}: temperatures over the room and drift of home by the truth, means; how far the laser is off',
                ['min', *(f'{kind} [K]' for kind in KINDS), *axes, 'laser off [um]'],
                homes,
            ),
            Table(
                f'{what}: largest error of the move, worst coordinate by the truth, mean (95 %) um of {counted}'
                '; recalibrated: the joints learn; tool learns: the joints too',
                ['min', *ERRORS.values()],
                errors,
            ),
            Table(
                f'{what}: error at rest over the travel, root mean square by the truth, calibrated cold, and now',
                ['min', *(f'{c} {when} [um]' for c in coordinates for when in ('cold', 'now'))],
                rests,
            ),
        ]
        data[machine] = rows
    return tables, {'experiment': 'drift', 'seeds': seeds, 'cycles': cycles, **data}


def runs_of(found, machine):
    """Return {run: list of the results of its specimens} of one machine."""
    return {run: [found[key] for key in found if key[:2] == (machine, run)] for run in (*RUNS, RECALIBRATED)}


def worst(errors):
    """Return `errors` (..., m) of the coordinate with the largest mean."""
    means = errors.reshape(-1, errors.shape[-1]).mean(axis=0)
    return errors[..., int(means.argmax())]


def _row(runs, i, counted, coordinates):
    """Return the figures of one of `MINUTES`, whose cycles are `counted`."""
    fixed = runs['fixed']
    warm = np.mean([run.temperatures[counted] for run in fixed], axis=(0, 1))
    home, seen = (np.array([getattr(run, key)[counted] for run in fixed]) for key in ('home', 'laser'))
    errors = {run: np.array([each.error[counted] for each in runs[run]]) for run in RUNS}
    errors[RECALIBRATED] = np.array([each.error[i] for each in runs[RECALIBRATED]])
    rest = {
        key: dict(zip(coordinates, UM * np.sqrt(np.mean([getattr(each, of)[i] ** 2 for each in runs[RECALIBRATED]], 0)),
                      strict=True))
        for key, of in (('rest_cold_um', 'rest_before'), ('rest_new_um', 'rest'))
    }  # fmt: skip
    return {
        'temperature_K': {
            kind: float(np.mean([t for node, t in zip(fixed[0].nodes, warm, strict=True) if node.startswith(kind)]))
            for kind in KINDS
        },
        'home_um': dict(zip(coordinates, UM * home.mean(axis=(0, 1)), strict=True)),
        'unseen_um': _spread(np.abs((seen - home).mean(axis=1))),
        'error_um': {run: _spread(worst(errors[run])) for run in ERRORS},
        **rest,
    }


def _spread(values):
    found = spread(values, UM)
    return {'mean': found.mean, 'p95': found.p95}


def _cell(found):
    return f'{found["mean"]:.2f} ({found["p95"]:.2f})'


def _per_kelvin_table():
    rows = []
    for machine, name in MACHINES.items():
        coordinates = load_machine(machine).coordinates
        scale = UM * np.array([ARM if c in ANGLES else 1.0 for c in coordinates])
        for what, shift in zip(('plant', 'pkm budget'), per_kelvin(machine), strict=True):
            cells = dict(zip(coordinates, (f'{value:.2f}' for value in np.abs(scale * shift)), strict=True))
            rows.append([name, what, *(cells.get(axis, '') for axis in ('x', 'y', 'z', 'phi'))])
    title = 'shift of the end point at home with all links and offsets 1 K warmer [um]; phi on 50 mm'
    return Table(title, ['', '', 'x', 'y', 'z', 'phi'], rows)
