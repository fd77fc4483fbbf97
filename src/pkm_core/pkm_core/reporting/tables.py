"""The tables of the report as plain rows, in the form of the thesis's Tables 7.2, 7.3, 8.2 and 8.3."""

from dataclasses import dataclass

from pkm_core.reporting.histories import end_point_histories, joint_histories, laser_histories
from pkm_core.reporting.summary import axis_figures, first_and_last
from pkm_core.thesis.results import END_POINT, JOINT_SPACE

QUANTITIES = {  # label and format of the quantities of `axis_figures`
    'max_dynamic_error_um': ('max dynamic error [um]', '{:.1f}'),
    'settling_5um_ms': ('settling to 5 um [ms]', '{:.1f}'),
    'settling_1um_ms': ('settling to 1 um [ms]', '{:.1f}'),
    'steady_state_error_um': ('steady-state error [um]', '{:.2f}'),
}


@dataclass(frozen=True)
class Table:
    """Headings and rows of text."""

    title: str
    headings: list[str]
    rows: list[list[str]]


def run_figures(run):
    """
    Return the figures of a `Run`: {space: {cycle: {axis: {quantity: value}}}} of its first and last cycle.

    Spaces are 'joints', 'end_point' and, with a laser, 'laser'. None means that an axis does not settle.
    """
    figures = {'joints': {}, 'end_point': {}, 'laser': {}}
    for record in first_and_last(run.records):
        spaces = {
            'joints': joint_histories(record),
            'end_point': end_point_histories(record, run.machine),
            'laser': laser_histories(record),
        }
        for space, histories in spaces.items():
            if histories is not None:
                figures[space][record.cycle] = {n: axis_figures(m) for n, m in histories.metrics().items()}
    return {space: cycles for space, cycles in figures.items() if cycles}


def space_tables(runs, figures):
    """Return the tables of joints and end point: first and last cycle of each run, and the thesis."""
    titles = {
        'joints': 'Joints, by the encoders',
        'end_point': 'End point, by forward kinematics of the encoders',
        'laser': 'End point, by the laser',
    }
    return [
        _space_table(title, space, runs, figures)
        for space, title in titles.items()
        if any(space in figures_of_run for figures_of_run in figures)
    ]


def _space_table(title, space, runs, figures):
    theirs = (JOINT_SPACE if space == 'joints' else END_POINT).get(runs[0].machine.name)
    ours = [
        (f'{run.name}, cycle {cycle}', axes)
        for run, of_run in zip(runs, figures, strict=True)
        for cycle, axes in of_run.get(space, {}).items()
    ]
    headings = ['', 'axis', *(name for name, _ in ours)]
    if theirs:
        headings += [f'thesis, {column}' for column in theirs.columns]
        title = f'{title}; in the form of {theirs.title}'
    rows = []
    axes = list(dict.fromkeys(axis for _, of_cycle in ours for axis in of_cycle))
    for quantity, (label, form) in QUANTITIES.items():
        reported = theirs.values.get(quantity, {}) if theirs else {}
        for axis in axes:
            row = [cell(of_cycle[axis][quantity], form, 'never') if axis in of_cycle else '' for _, of_cycle in ours]
            if theirs:
                missing = [''] * len(theirs.columns)
                row += [cell(v, form, 'lost') for v in reported[axis]] if axis in reported else missing
            rows.append([label if axis == axes[0] else '', axis, *row])
    return Table(title, headings, rows)


def cell(value, form, instead):
    """Return a number as text, and `instead` for None."""
    if value is None:
        return instead
    text = form.format(value)
    return text if float(text) else text.removeprefix('-')  # no negative zero


def moves_table(run):
    """Return the table of settling times after each move of the first and the last cycle, joints and end point."""
    headings, rows = ['axis'], []
    cycles = []
    for record in first_and_last(run.records):
        moves = joint_histories(record).metrics_of_moves() | end_point_histories(record, run.machine).metrics_of_moves()
        cycles.append(moves)
        headings += [f'cycle {record.cycle}, move {n + 1}' for n in range(len(record.move_starts))]
    for axis in cycles[0]:
        settled = [axis_figures(metrics)['settling_5um_ms'] for moves in cycles for metrics in moves[axis]]
        rows.append([axis, *(cell(value, '{:.1f}', 'never') for value in settled)])
    return Table(f'{run.name}: settling to 5 um after each move [ms]', headings, rows)


def messages_table(run, messages):
    """Return the table of messages recorded and expected by topic."""
    rows = [
        [topic, str(count['recorded']), '' if count['expected'] is None else str(count['expected'])]
        for topic, count in messages.items()
    ]
    return Table(f'{run.name}: messages', ['topic', 'recorded', 'expected'], rows)
