"""Tables 7.2, 7.3, 8.2 and 8.3: every figure of a study with that of the thesis, one row per controller."""

from pkm_core.experiments.condition import environments
from pkm_core.experiments.outcome import counted, spread, worst_axis
from pkm_core.reporting.tables import Table
from pkm_core.thesis.results import END_POINT, JOINT_SPACE

QUANTITIES = {  # of `AxisMetrics`: key in `pkm_core.thesis.results` and JSON, heading, factor, format
    'max_dynamic_error': ('max_dynamic_error_um', 'max dynamic error [um]', 1e6, '{:.1f}'),
    'settling_time_5um': ('settling_5um_ms', 'settling to 5 um [ms]', 1e3, '{:.1f}'),
    'settling_time_1um': ('settling_1um_ms', 'settling to 1 um [ms]', 1e3, '{:.1f}'),
    'steady_state_error': ('steady_state_error_um', 'steady-state error [um]', 1e6, '{:.2f}'),
}
WORST = 'worst'  # of the axes


def joint_rows(study):
    """Return the rows of Table 7.2 or 8.2 as dicts; errors by the encoders, the worst axis of a cycle last."""
    machine = study.experiment
    axes = [*study.outcomes['robust', 'nominal'][0].joints, WORST]
    return _rows(study, study.conditions(machine), 'encoders', axes, JOINT_SPACE[machine])


def end_point_rows(study):
    """
    Return the rows of Table 7.3 or 8.3, errors by the laser; empty without a laser.

    Settling to 1 um is omitted: the resolution of the laser, 0.91 um, is too coarse for it.
    """
    if not study.outcomes['robust', 'nominal'][0].laser:
        return []
    axes = study.outcomes['robust', 'nominal'][0].coordinates
    rows = _rows(study, study.conditions(), 'laser', axes, END_POINT[study.experiment])
    return [row for row in rows if row['quantity'] != 'settling_1um_ms']


def _rows(study, conditions, source, axes, reported):
    rows = []
    for quantity, (key, _, factor, _) in QUANTITIES.items():
        for axis in axes:
            for condition in conditions:
                spreads = {
                    environment: _spread(
                        study.outcomes.get((condition.name, environment), []), source, quantity, axis, factor
                    )
                    for environment in environments(study.experiment)
                }
                if spreads['nominal'] is not None:
                    thesis = _thesis(reported, key, axis, condition.column)
                    rows.append({'quantity': key, 'axis': axis, 'control': condition.name, 'thesis': thesis, **spreads})
    return rows


def _spread(outcomes, source, quantity, axis, factor):
    """Return the `Spread` of one axis in um or ms, None if the machine has no such axis or no such environment."""
    if not outcomes:
        return None
    if axis == WORST:
        values = worst_axis(outcomes, quantity)[:, outcomes[0].counted]
    else:
        axes = outcomes[0].joints if source == 'encoders' else outcomes[0].coordinates
        if axis not in axes:
            return None
        values = counted(outcomes, source, quantity)[:, axes.index(axis)]
    return spread(values, factor)


def _thesis(reported, key, axis, column):
    """Return the value of the thesis, 'lost' for an illegible cell, or None without a cell."""
    if column not in reported.columns or axis not in reported.values.get(key, {}):
        return None
    value = reported.values[key][axis][reported.columns.index(column)]
    return 'lost' if value is None else value


def spread_table(title, rows, environments):
    """Return `rows` as a `Table`: mean (95th percentile), or the share of cycles in which an axis does not settle."""
    headings = ['', 'axis', 'control', 'thesis', *environments]
    labels = {key: (heading, form) for key, heading, _, form in QUANTITIES.values()}
    cells, before = [], (None, None)
    for row in rows:
        heading, form = labels[row['quantity']]
        here = row['quantity'], row['axis']
        thesis = row['thesis']
        cells.append([
            heading if here[0] != before[0] else '',
            row['axis'] if here != before else '',
            row['control'],
            '' if thesis is None else thesis if thesis == 'lost' else form.format(thesis),
            *(_text(row[each], form) for each in environments),
        ])  # fmt: skip
        before = here
    return Table(title, headings, cells)


def _text(found, form):
    if found is None:
        return ''
    if found.never:
        return f'{100 * found.never:.0f} % never'
    mean = form.format(found.mean)
    return f'{mean if float(mean) else mean.removeprefix("-")} ({form.format(found.p95)})'  # no negative zero
