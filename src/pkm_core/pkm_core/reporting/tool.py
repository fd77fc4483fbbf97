"""
The tool by laser: its error against the commanded path, during the moves and at rest.

A laser shows a moving point no better than to one of its steps, so the largest error cannot be shown to be smaller than
that; the rms and the rests can. The error counts from the rest before the first move, because the datum is unknown.
"""

import numpy as np
from rich.markup import escape
from rich.table import Table as RichTable

from pkm_core.reporting.histories import ARM, laser_histories, lengths
from pkm_core.reporting.summary import first_and_last
from pkm_core.reporting.tables import Table

# [m] differences below are rounding of a number, not a step of the laser
_ROUNDING = 1e-9
FIGURES = ('moves_rms_um', 'moves_largest_um', 'rests_rms_um', 'rests_largest_um')


def tool_figures(record):
    """
    Return {coordinate: {figure: value}} of a `CycleRecord`, {} without a laser; figures are those of `FIGURES`.

    Errors of all samples from the start of a move to the end of its profile, and of all others; phi on `ARM`.
    """
    histories = laser_histories(record)
    if histories is None:
        return {}
    moving = np.zeros(len(histories.error), dtype=bool)
    for start, end in zip(histories.move_starts, histories.move_ends, strict=True):
        moving[start : end + 1] = True
    return {
        name: dict(zip(FIGURES, (*_size(column[moving]), *_size(column[~moving])), strict=True))
        for name, column in zip(histories.names, histories.error.T, strict=True)
    }


def laser_step(records):
    """Return the step [m] of the laser, the least difference between two of its readings; None without a laser."""
    steps = []
    for record in first_and_last(records):
        histories = laser_histories(record)
        if histories is not None:
            rows = np.unique(record.laser * lengths(histories.names))
            steps.append(np.diff(rows)[np.diff(rows) > _ROUNDING].min(initial=np.inf))
    return float(min(steps)) if steps and np.isfinite(min(steps)) else None


def tool_rows(records):
    """Return [coordinate, figures in um] of the first and the last of `records`, as text; [] without a laser."""
    shown = [figures for figures in map(tool_figures, first_and_last(records)) if figures]
    return [
        [name, *(' -> '.join(f'{figures[name][figure]:.2f}' for figures in shown) for figure in FIGURES)]
        for name in (shown[0] if shown else ())
    ]


def _explanation(records):
    """Return the title of a table of `tool_rows`, in two parts."""
    cycles = ' -> '.join(str(record.cycle) for record in first_and_last(records))
    step = laser_step(records)
    shown = '' if step is None else f'; one step of the laser is {1e6 * step:.2f} um'
    return f'by laser against the commanded path, cycle {cycles}', f'phi on {1e3 * ARM:g} mm{shown}'


def tool_table(records):
    """Return the table of the tool for the terminal, first and last cycle; None without a laser."""
    rows = tool_rows(records)
    if not rows:
        return None
    what, units = _explanation(records)
    table = RichTable(title=f'tool {what}:\n{units}', title_justify='left')
    for heading in ('tool', 'moves, rms\n[um]', 'largest\n[um]', 'rests, rms\n[um]', 'largest\n[um]'):
        table.add_column(escape(heading), justify='left' if heading == 'tool' else 'right')
    for row in rows:
        table.add_row(*row)
    return table


def path_table(runs):
    """Return the same figures of several `Run`s as a `Table` for the page; None if none has a laser."""
    rows = [[f'{run.name}, {row[0]}', *row[1:]] for run in runs for row in tool_rows(run.records)]
    if not rows:
        return None
    headings = ['', 'moves, rms [um]', 'moves, largest [um]', 'rests, rms [um]', 'rests, largest [um]']
    return Table(f'Tool {"; ".join(_explanation(runs[0].records))}', headings, rows)


def _size(errors):
    """Return the rms and the largest [um] of `errors` (K,) [m], 0 without any."""
    if not errors.size:
        return 0.0, 0.0
    return 1e6 * float(np.sqrt(np.mean(np.square(errors)))), 1e6 * float(np.abs(errors).max())
