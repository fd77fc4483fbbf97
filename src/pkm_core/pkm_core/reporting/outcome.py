"""The outcome of a run in one sentence and one table: first cycle, last cycle, thesis."""

from pkm_core.reporting.summary import first_and_last
from pkm_core.reporting.tables import Table, cell
from pkm_core.thesis.results import JOINT_SPACE

_LEARNED = 'robust learning'  # column of the thesis


def outcome_sentence(run, figures):
    """
    Return the outcome of a run in words.

    Parameters
    ----------
    run : pkm_core.reporting.runs.Run
        Its whole cycles.
    figures : dict
        From `run_figures`.

    """
    joints = figures['joints']
    cycles = [record.cycle for record in first_and_last(run.records)]
    worst = [max(joints[cycle].items(), key=lambda item: item[1]['max_dynamic_error_um']) for cycle in cycles]
    axis, values = worst[-1]
    text = f'{run.name}: {run.records[-1].motion} on {run.machine.name}, law {run.records[-1].learning_law}: '
    reached = f'{values["max_dynamic_error_um"]:.1f} um ({axis})'
    if len(cycles) == 1:
        return f'{text}the largest dynamic error of an axis is {reached} in cycle {cycles[0]}.'
    first_axis, first = worst[0]
    before = f'{first["max_dynamic_error_um"]:.1f} um ({first_axis}) in cycle {cycles[0]}'
    text += f'the largest dynamic error of an axis went from {before} to {reached} in cycle {cycles[1]}'
    if values['max_dynamic_error_um'] >= first['max_dynamic_error_um']:
        return f'{text}: no gain.'
    return f'{text}, {first["max_dynamic_error_um"] / values["max_dynamic_error_um"]:.1f} times less.'


def outcome_table(runs, figures):
    """Return the one table of a report: largest dynamic error and settling of each axis, first and last cycle."""
    theirs = JOINT_SPACE.get(runs[0].machine.name)
    headings = ['axis']
    for run in runs:
        name = f'{run.name}, ' if len(runs) > 1 else ''
        headings += [f'{name}cycle {record.cycle} [um]' for record in first_and_last(run.records)]
        headings.append('5 um after [ms]')
    headings += ['thesis, learned [um]'] if theirs else []
    rows = []
    for axis in dict.fromkeys(joint for run in runs for joint in run.machine.joints):
        row = [axis]
        for run, of_run in zip(runs, figures, strict=True):
            cycles = [of_run['joints'][record.cycle].get(axis) for record in first_and_last(run.records)]
            row += [cell(each['max_dynamic_error_um'], '{:.1f}', '') if each else '' for each in cycles]
            row.append(cell(cycles[-1]['settling_5um_ms'], '{:.1f}', 'never') if cycles[-1] else '')
        if theirs:
            reported = theirs.values['max_dynamic_error_um'].get(axis)
            row.append('' if reported is None else cell(reported[theirs.columns.index(_LEARNED)], '{:.1f}', 'lost'))
        rows.append(row)
    return Table('Largest dynamic error of each axis, and its settling time to 5 um in the last cycle', headings, rows)
