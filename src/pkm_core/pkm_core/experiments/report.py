"""Results of an experiment: tables for the terminal and as Markdown, and all values as data."""

from dataclasses import asdict

from pkm_core.experiments.condition import environments
from pkm_core.experiments.design_tables import effort_table, size_table
from pkm_core.experiments.outcome import worst_axis
from pkm_core.experiments.tables import end_point_rows, joint_rows, spread_table
from pkm_core.experiments.tool_targets import SPECIMENS
from pkm_core.reporting.histories import ARM
from pkm_core.reporting.tables import Table
from pkm_core.thesis.results import END_POINT, JOINT_SPACE


def study_report(study):
    """Return (list of `Table`, figures as a nested dict) of a `Study`."""
    machine = study.experiment
    spread = f'mean (95 %) of {study.seeds} noise seeds x {study.cycles} cycles'
    joints, end_point = joint_rows(study), end_point_rows(study)
    every = environments(machine)
    driven = [name for name in every if name != 'exact']  # links do not act on the joints
    tables = [spread_table(f'{JOINT_SPACE[machine].title}, joints by the encoders; {spread}', joints, driven)]
    if end_point:
        tables.append(spread_table(f'{END_POINT[machine].title}, end point by the laser; {spread}', end_point, every))
    if machine == 'planar':
        tables += [effort_table(study), size_table()]
    figures = {
        'experiment': machine,
        'arrangement': study.arrangement,
        'seeds': study.seeds,
        'cycles': study.cycles,
        'joints': _data(joints),
        'end_point_by_laser': _data(end_point),
        'worst_axis_um_by_cycle': {
            name: {
                environment: 1e6 * worst_axis(outcomes)
                for (n, environment), outcomes in study.outcomes.items()
                if n == name
            }
            for name, _ in study.outcomes
        },
        'tables': {table.title: [table.headings, *table.rows] for table in tables[1 + bool(end_point) :]},
        'notices': [
            f'{name}, {environment}, seed {each.seed}: {notice}'
            for (name, environment), outcomes in study.outcomes.items()
            for each in outcomes
            for notice in each.notices
        ],
    }
    return tables, figures


def _data(rows):
    return [{key: asdict(value) if hasattr(value, 'p95') else value for key, value in row.items()} for row in rows]


def markdown(table):
    """Return a `Table` as Markdown."""
    lines = [f'**{table.title}**', '', *('| ' + ' | '.join(row) + ' |' for row in (table.headings, *table.rows))]
    lines.insert(3, '|---' * len(table.headings) + '|')
    return '\n'.join(lines) + '\n'


def targets_report(rows, seeds, cycles):
    """Return ([`Table`], figures) of the `Target`s `rows`."""
    verdicts = {True: 'yes', False: 'NO', None: ''}
    title = (
        f'Goals: mean (95 %) of {seeds} noise seeds x {cycles} cycles, worst axis by the encoders, nominal; '
        f'of the tool: {SPECIMENS * seeds} specimens x {cycles} cycles, phi on {1e3 * ARM:g} mm'
    )
    headings = ['', 'thesis', 'goal', 'reached', 'met']
    cells = [[row.what, row.thesis, row.goal, row.reached, verdicts[row.met]] for row in rows]
    data = {'experiment': 'targets', 'seeds': seeds, 'cycles': cycles, 'targets': [asdict(row) for row in rows]}
    return [Table(title, headings, cells)], data
