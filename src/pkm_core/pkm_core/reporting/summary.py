"""Results of a run of motion cycles, as data and as a table."""

from collections import Counter
from math import isnan

from rich.markup import escape
from rich.table import Table

from pkm_core.thesis.results import JOINT_SPACE


def axis_figures(metrics):
    """Return the figures of one `AxisMetrics` in um and ms; None if the axis does not settle."""
    return {
        'max_dynamic_error_um': 1e6 * metrics.max_dynamic_error,
        'settling_5um_ms': _or_none(1e3 * metrics.settling_time_5um),
        'settling_1um_ms': _or_none(1e3 * metrics.settling_time_1um),
        'steady_state_error_um': 1e6 * metrics.steady_state_error,
    }


def _or_none(value):
    return None if isnan(value) else value


def first_and_last(records):
    """Return the first and the last of `records`, or the only one."""
    return [records[0], records[-1]] if len(records) > 1 else records


def cycle_figures(record):
    """Return the figures of one `CycleRecord` by joint."""
    return {joint: axis_figures(metrics) for joint, metrics in zip(record.joints, record.metrics(), strict=True)}


def messages(records):
    """Return {topic: {'recorded': m, 'expected': n or None}} over all `records`."""
    recorded, expected = Counter(), Counter()
    for record in records:
        recorded.update(record.recorded)
        expected.update(record.expected)
    return counts_by_topic(recorded, expected)


def counts_by_topic(recorded, expected):
    """Return {topic: {'recorded': m, 'expected': n or None}} of two counters."""
    return {topic: {'recorded': recorded[topic], 'expected': expected.get(topic)} for topic in sorted(recorded)}


def account(counts):
    """Return lines on the `messages` of a run: how many are recorded, which are lost, and a surplus."""
    counted = {topic: entry for topic, entry in counts.items() if entry['expected'] is not None}
    recorded, expected = (sum(entry[key] for entry in counted.values()) for key in ('recorded', 'expected'))
    lost = {topic: entry['expected'] - entry['recorded'] for topic, entry in counted.items()}
    lost = {topic: count for topic, count in lost.items() if count > 0}
    surplus = recorded - expected + sum(lost.values())
    lines = [f'{recorded} messages recorded of {expected} expected: {sum(lost.values())} lost']
    if lost:
        topics = ', '.join(f'{count} of {topic}' for topic, count in lost.items())
        lines.append(f'lost: {topics}; the nodes that publish them were stopped or too slow')
    if surplus:
        lines.append(f'{surplus} messages more than expected: topics of the cell have further publishers')
    return lines


def cycles_table(machine_name, records):
    """Return the table of the first and the last cycle with the values of the thesis."""
    heading = f'{records[0].motion}, learning law {records[-1].learning_law}:'
    explanation = 'largest dynamic error, settling time to a band, mean error at rest'
    table = Table(title=f'{heading}\n{explanation}', title_justify='left')
    headings = ('axis', 'cycle', 'error\n[um]', '5 um\n[ms]', '1 um\n[ms]', 'rest\n[um]')
    for heading in (*headings, 'thesis', 'error\n[um]', '5 um\n[ms]'):
        table.add_column(escape(heading), justify='left' if heading in ('axis', 'thesis') else 'right')
    shown = first_and_last(records)
    figures = [cycle_figures(record) for record in shown]
    for joint in records[0].joints:
        for row, record in enumerate(shown):
            ours = figures[row][joint]
            table.add_row(
                '' if row else joint,
                str(record.cycle),
                f'{ours["max_dynamic_error_um"]:.1f}',
                _or(ours['settling_5um_ms'], 'never' if record.moves else '-'),
                _or(ours['settling_1um_ms'], 'never' if record.moves else '-'),
                f'{ours["steady_state_error_um"]:.2f}',
                *_thesis_cells(machine_name, joint, ('robust', 'robust learning')[row]),
                end_section=record is shown[-1],
            )
    return table


def _thesis_cells(machine_name, joint, column):
    """Return the values of the thesis for one joint in a `column`, blanks for a machine without a table."""
    reported = JOINT_SPACE.get(machine_name)
    if reported is None:
        return '', '', ''
    index = reported.columns.index(column)
    error, settling = (reported.values[name][joint][index] for name in ('max_dynamic_error_um', 'settling_5um_ms'))
    return 'learned' if column == 'robust learning' else column, _or(error, 'lost'), _or(settling, 'lost')


def _or(value, otherwise):
    return otherwise if value is None else f'{value:.1f}'
