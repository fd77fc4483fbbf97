"""What a run of motion cycles has shown: results as data, as a table and as a picture."""

from collections import Counter
from math import isnan

import numpy as np
from rich.markup import escape
from rich.table import Table

from pkm_core.thesis import REPORTED


def cycle_figures(record):
    """Return the figures of one `CycleRecord` by joint, in um and ms; None where an axis never settles."""
    return {
        joint: {
            'max_dynamic_error_um': 1e6 * metrics.max_dynamic_error,
            'settling_5um_ms': _or_none(1e3 * metrics.settling_time_5um),
            'settling_1um_ms': _or_none(1e3 * metrics.settling_time_1um),
            'steady_state_error_um': 1e6 * metrics.steady_state_error,
        }
        for joint, metrics in zip(record.joints, record.metrics(), strict=True)
    }


def _or_none(value):
    return None if isnan(value) else value


def messages(records):
    """Return {topic: {'recorded': m, 'expected': n or None}} over all `records`."""
    recorded, expected = Counter(), Counter()
    for record in records:
        recorded.update(record.recorded)
        expected.update(record.expected)
    return {topic: {'recorded': recorded[topic], 'expected': expected.get(topic)} for topic in sorted(recorded)}


def cycles_table(machine_name, records):
    """Return the table of first against last cycle, each beside what the thesis reports for its machine."""
    heading = f'{records[0].motion}, learning law {records[-1].learning_law}:'
    explanation = 'largest dynamic error, settling time to a band, mean error at rest'
    table = Table(title=f'{heading}\n{explanation}', title_justify='left')
    headings = ('axis', 'cycle', 'error\n[um]', '5 um\n[ms]', '1 um\n[ms]', 'rest\n[um]')
    for heading in (*headings, 'thesis', 'error\n[um]', '5 um\n[ms]'):
        table.add_column(escape(heading), justify='left' if heading in ('axis', 'thesis') else 'right')
    reported = REPORTED.get(machine_name, {})
    first, last = cycle_figures(records[0]), cycle_figures(records[-1])
    for joint in records[0].joints:
        thesis = reported.get(joint)
        rows = (
            (records[0], first[joint], thesis and ('robust', thesis.robust_error, thesis.robust_settling)),
            (records[-1], last[joint], thesis and ('learned', thesis.learned_error, thesis.learned_settling)),
        )
        for record, figures, theirs in rows[: len(records)]:
            kind, error, settling = theirs or ('', None, None)
            table.add_row(
                joint if record is records[0] else '',
                str(record.cycle),
                f'{figures["max_dynamic_error_um"]:.1f}',
                _or(figures['settling_5um_ms'], 'never'),
                _or(figures['settling_1um_ms'], 'never'),
                f'{figures["steady_state_error_um"]:.2f}',
                kind,
                _or(error, ''),
                _or(settling, 'lost' if theirs else ''),
                end_section=record is records[-1],
            )
    return table


def _or(value, otherwise):
    return otherwise if value is None else f'{value:.1f}'


def plot_cycles(records, path):
    """Draw error per cycle and the first and last cycle's error over time into the PNG `path`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    joints, first, last = records[0].joints, records[0], records[-1]
    worst = np.array([[1e6 * axis.max_dynamic_error for axis in record.metrics()] for record in records])
    figure = Figure(figsize=(11, 2.2 + 1.5 * len(joints)), layout='constrained')
    FigureCanvasAgg(figure)
    left, right = figure.subfigures(1, 2, width_ratios=[2, 3])
    axes = left.subplots()
    for joint, errors in zip(joints, worst.T, strict=True):
        axes.semilogy([record.cycle for record in records], errors, marker='o', markersize=4, label=joint)
    axes.set(xlabel='cycle', ylabel='max dynamic error [um]', title=f'{first.motion}, law {last.learning_law}')
    axes.grid(which='both', alpha=0.3)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend()
    for column, (joint, axes) in enumerate(
        zip(joints, np.atleast_1d(right.subplots(len(joints), 1, sharex=True)), strict=True)
    ):
        for start, end in zip(first.move_starts, first.move_ends, strict=True):
            axes.axvspan(1e3 * start * first.sample_time, 1e3 * end * first.sample_time, color='0.93')
        for record, colour in ((first, '0.6'), (last, 'C0')):
            time = 1e3 * record.sample_time * np.arange(len(record.error))
            axes.plot(time, 1e6 * record.error[:, column], color=colour, linewidth=0.9, label=f'cycle {record.cycle}')
        axes.set(ylabel=f'{joint} [um]')
        axes.grid(alpha=0.3)
    axes.set_xlabel('time [ms]; moves are shaded')
    right.axes[0].set_title('error, reference minus encoder')
    right.axes[0].legend(ncols=2, loc='upper right', fontsize='small')
    figure.savefig(path, dpi=110)
