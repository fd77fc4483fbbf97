"""Tables and figure of `pkm experiment stage`."""

import numpy as np

from pkm_core.experiments.stage_assumptions import SHIPPED
from pkm_core.experiments.stage_claim import (
    FRICTIONS,
    LATE,
    MAP_CYCLES,
    MODES,
    ROWS,
    SINGLE,
    highest_mode,
    holds,
    thesis_settling,
)
from pkm_core.plotting import new_figure, save
from pkm_core.reporting.tables import Table

AXES = ('x', 'y')
_NEVER = 80.0  # [ms] shown for a stage that does not settle in the window after a move


def stage_report(found, seeds, cycles):
    """Return ([`Table`], figures as a nested dict) of a `Claim`."""
    tables = [
        _assumptions(found, seeds, cycles),
        _map(found),
        _range(found),
        _single(found),
    ]
    data = {
        'experiment': 'stage',
        'seeds': seeds,
        'cycles': cycles,
        'planar_ms': _data(found.planar),
        'planar_thesis_gains_ms': _data(found.planar_weak),
        'four_dof_ms': {name: _data([each])[0] for name, each in found.four_dof.items()},
        'assumptions_ms': {name: _data(pair) for name, pair in found.rows.items()},
        'map_ms': {f'{friction:g} N, {mode:g} Hz': _data(pair) for (friction, mode), pair in found.cells.items()},
        'single_ms': {name: _data(pair) for name, pair in found.single.items()},
    }
    return tables, data


def _data(pair):
    return [{'mean_ms': each.mean, 'p95_ms': each.p95, 'never': each.never} for each in pair]


def _text(each):
    return f'{100 * each.never:.0f} % never' if each.never else f'{each.mean:.1f} ({each.p95:.1f})'


def _assumptions(found, seeds, cycles):
    title = (
        f'Settling to 5 um by the laser [ms], robust law: mean (95 %) of {seeds} noise seeds x {cycles} cycles; '
        'one assumption about the XY stage at a time'
    )
    stage, planar = thesis_settling('planar', 'XY stage'), thesis_settling('planar', 'robust')
    rows = [
        ['thesis, XY stage', *(f'{stage[axis]:.1f}' for axis in AXES), ''],
        ['thesis, planar machine', *(f'{planar[axis]:.1f}' for axis in AXES), ''],
        ['planar machine, 80 ms', *map(_text, found.planar), ''],
        ['planar machine, gains of planar_thesis', *map(_text, found.planar_weak), ''],
    ]
    rows += [
        [f'XY stage, {name}', *map(_text, pair), _verdict(holds(found, pair))] for name, pair in found.rows.items()
    ]
    return Table(title, ['', 'x', 'y', 'stage is later in'], rows)


def _verdict(pair):
    return ' and '.join(axis for axis, later in zip(AXES, pair, strict=True) if later) or 'none'


def _map(found):
    title = (
        f'Settling of the stage [ms], x / y, noise seed 1, {MAP_CYCLES} cycles; *: later than the planar machine in '
        'both; -: does not settle within 80 ms'
    )
    rows = []
    for friction in FRICTIONS:
        cells = [found.cells[friction, mode] for mode in MODES]
        rows.append([f'{friction:g} N', *(_cell(pair, holds(found, pair)) for pair in cells)])
    return Table(title, ['friction', *(f'{mode:g} Hz' for mode in MODES)], rows)


def _cell(pair, later):
    times = ['-' if each.never else f'{each.mean:.0f}' for each in pair]
    return ' / '.join(times) + (' *' if all(later) else '')


def _range(found):
    rows = []
    for friction in FRICTIONS:
        highest = [highest_mode(found, friction, axis) for axis in range(len(AXES))]
        rows.append([f'{friction:g} N', *('none' if np.isnan(mode) else f'{mode:g} Hz' for mode in highest)])
    title = 'Highest first mode of the map with which the stage settles later than the planar machine'
    return Table(title, ['friction', *AXES], rows)


def _single(found):
    thesis = {name: thesis_settling('four_dof', name) for name in ('single stages', 'robust')}
    shipped = dict(zip(AXES, found.rows[next(iter(ROWS))], strict=True))
    late = dict(zip(AXES, found.rows[f'first mode {LATE:g} Hz'], strict=True))
    for name, times in (('shipped', shipped), ('late', late)):
        times |= dict(zip(('z', 'phi'), found.single[name], strict=True))
    rows = [
        [
            axis,
            *(f'{thesis[name][axis]:.1f}' for name in thesis),
            *(_text(each) for each in (shipped[axis], late[axis], found.four_dof[axis])),
        ]
        for axis in found.four_dof
    ]
    single = SINGLE['shipped']
    title = (
        f'Table 8.3, single stages, settling to 5 um [ms]; z and phi: {single.masses[0]:g} and {single.masses[1]:g} kg '
        f'at the radius of 50 mm, {1e3 * single.move[0]:g} mm in {1e3 * single.move_time:g} ms, '
        f'{single.friction:g} N; phi as displacement'
    )
    headings = ['', 'thesis, stages', 'thesis, 4-DOF', f'stages, {SHIPPED.mode:g} Hz', f'stages, {LATE:g} Hz', '4-DOF']
    return Table(title, headings, rows)


def draw_stage(folder, found):
    """Write stage_claim.png for a `Claim`: later or earlier than the planar machine, over friction and first mode."""
    figure = new_figure(11.0, 5.0)
    panels = figure.subplots(1, 2)
    shown = [_panel(axes, found, axis) for axis, axes in enumerate(panels)]
    figure.colorbar(shown[0], ax=panels, label='settling of the stage less that of the planar machine [ms]')
    figure.suptitle('Settling of the XY stage to 5 um [ms]. Line: limit of the claim. Square: as shipped', fontsize=10)
    save(figure, folder, 'stage_claim')


def _panel(axes, found, axis):
    """Draw the map of one axis and return its colours."""
    planar = found.planar[axis]
    pairs = [[found.cells[friction, mode][axis] for mode in MODES] for friction in FRICTIONS]
    times = np.array([[min(each.mean, _NEVER) for each in row] for row in pairs])
    shown = axes.pcolormesh(times - planar.mean, cmap='RdBu_r', vmin=-80.0, vmax=80.0)
    for row, cells in enumerate(pairs):
        for column, each in enumerate(cells):
            text = 'never' if each.never else f'{each.mean:.0f}'
            axes.text(column + 0.5, row + 0.5, text, ha='center', va='center', fontsize=8)
    _border(axes, np.array([[holds(found, found.cells[f, mode])[axis] for mode in MODES] for f in FRICTIONS]))
    place = MODES.index(SHIPPED.mode) + 0.5, FRICTIONS.index(SHIPPED.friction) + 0.5
    axes.plot(*place, 's', markersize=24, markerfacecolor='none', markeredgecolor='black')
    axes.set_xticks(np.arange(len(MODES)) + 0.5, [f'{mode:g}' for mode in MODES])
    axes.set_yticks(np.arange(len(FRICTIONS)) + 0.5, [f'{friction:g}' for friction in FRICTIONS])
    stage, robust = (thesis_settling('planar', name)[AXES[axis]] for name in ('XY stage', 'robust'))
    title = f'{AXES[axis]}: planar machine {planar.mean:.1f} ms; thesis: {robust:g} ms, stage {stage:g} ms'
    axes.set_title(title, fontsize=9)
    axes.set(xlabel='first mode of the stage [Hz]', ylabel='Coulomb friction of each guide [N]')
    return shown


def _border(axes, later):
    """Draw the line between the cells of `later` (rows, columns) and the others."""
    rows, columns = later.shape
    for i in range(rows):
        for j in range(columns):
            if j + 1 < columns and later[i, j] != later[i, j + 1]:
                axes.plot([j + 1, j + 1], [i, i + 1], 'k', linewidth=2.5)
            if i + 1 < rows and later[i, j] != later[i + 1, j]:
                axes.plot([j, j + 1], [i + 1, i + 1], 'k', linewidth=2.5)
