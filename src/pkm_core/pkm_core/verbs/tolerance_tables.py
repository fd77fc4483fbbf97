"""Tables and figures of `pkm tolerance`: Tables 4.1 to 4.5 of the thesis beside the computed values."""

from pkm_core.thesis.tolerances import ERRORS, OBJECTIVES, STATISTICS
from pkm_core.verbs.console import table


def objectives_table(study, printed):
    """Return Table 4.1; `printed`: whether the thesis's values belong to the options."""
    columns = [(variant, grid) for variant in ('thesis', 'true') for grid in ('middle', 'all')]
    headings = [f'em_{variant}\n{grid}' for variant, grid in columns]
    rows: list = []
    for name, (initial, (l2, k10, value)) in OBJECTIVES.items():
        found = [study.objectives[name, *column] for column in columns]
        lines = (
            (f'{name}, initial', f'{initial:g}', [f'{each.initial:.6g}' for each in found]),
            ('   l [mm]', f'{l2:g}', [f'{1e3 * each.optimum.l2:.3f}' for each in found]),
            ('   k [mm]', f'{k10:g}', [f'{1e3 * each.optimum.k10:.3f}' for each in found]),
            (f'   {name}, optimum', f'{value:g}', [f'{each.optimum.value:.5g}' for each in found]),
        )
        rows += [(label, theirs if printed else '', *ours) for label, theirs, ours in lines]
        rows.append(None)
    return table('Table 4.1; angles of W: the middle one, or all', ['', 'thesis', *headings], rows)


def statistics_table(title, study, printed):
    """Return one of Tables 4.2 to 4.5; `printed`: whether the thesis's values belong to the options."""
    design = study.designs[title]
    rows: list = []
    for name in ('x', 'y', 'z', 'phi'):
        unit = '[urad]' if name == 'phi' else '[um]'
        if printed:
            theirs = ('' if value is None else f'{value:g}' for value in ERRORS[title][name])
            rows.append((f'{name} {unit} thesis', *theirs))
        ours = {
            variant: [f'{1e6 * value:z.3f}' for value in study.statistics[title, variant][name]]
            for variant in ('thesis', 'true')
        }
        rows.append((f'{name} {unit} em_thesis', *ours['thesis']))
        if ours['true'] != ours['thesis']:
            rows.append((f'{name} {unit} em_true', *ours['true']))
        rows.append(None)
    heading = f'{title}: l = {1e3 * design.l2:.5g} mm, k = {1e3 * design.k10:.6g} mm, links +1 um'
    return table(heading, ['error', *STATISTICS], rows)


def design_table(machine, design):
    """Return the objectives of the machine's own link lengths on the operational workspace."""
    geometry = machine.config.geometry
    rows = [
        (f'em_{variant}', *(f'{values[name]:.5g}' for name in ('f', 'f1', 'f2')), f'{1e3 * values["size"]:.1f}')
        for variant, values in design.values.items()
    ]
    caption = 'W asks for ' + ', '.join(
        f'{name} {1e3 * low:.1f} to {1e3 * high:.1f} mm'
        + ('' if low >= lower and high <= upper else f' (travel {1e3 * lower:g} to {1e3 * upper:g})')
        for name, low, high, lower, upper in design.joints_needed
    )
    title = f'{machine.name} on W, all angles: l = {1e3 * geometry.l2:g} mm, k = {1e3 * geometry.k10:g} mm'
    return table(title, ['', 'f', 'f1', 'f2', 'size [mm]'], rows, caption=caption)


def reachable_table(machine, reachable):
    """Return the magnification of link errors over all positions that the machine reaches."""
    squares, together, worst = reachable
    rows = [('sum of squared singular values', *_span(squares))]
    for title, errors in (('links +1 um', together), ('links +-1 um, worst signs', worst)):
        for name, column in zip(machine.coordinates, 1e6 * errors.T, strict=True):
            rows.append((f'{title}: {name} [{"urad" if name == "phi" else "um"}]', *_span(column)))
    return table(f'{machine.name} over all it reaches, em_true', ['', 'least', 'mean', 'most'], rows)


def _span(values):
    return [f'{value:.3g}' for value in (values.min(), values.mean(), values.max())]


def figures(machine, workspace, arm, result):
    """Return every figure of the `Result` as nested dicts; `workspace` and `arm` [mm] are the options of the verb."""
    study, design, front = result.study, result.design, result.front
    squares, together, worst = result.reachable

    def span(values):
        return {'least': values.min(axis=0), 'mean': values.mean(axis=0), 'most': values.max(axis=0)}

    return {
        'machine': machine.name,
        'workspace': workspace,
        'arm_mm': arm,
        'objectives': [
            {
                'objective': name,
                'error_matrix': f'em_{variant}',
                'angles': grid,
                'initial': each.initial,
                'l_mm': 1e3 * each.optimum.l2,
                'k_mm': 1e3 * each.optimum.k10,
                'value': each.optimum.value,
            }
            for (name, variant, grid), each in study.objectives.items()
        ],
        'error_statistics_um_urad': [
            {
                'table': title,
                'error_matrix': f'em_{variant}',
                **{name: {key: 1e6 * value for key, value in each._asdict().items()} for name, each in rows.items()},
            }
            for (title, variant), rows in study.statistics.items()
        ],
        'design_on_workspace': design.values,
        'joints': {
            name: {'needed_mm': [1e3 * low, 1e3 * high], 'travel_mm': [1e3 * lower, 1e3 * upper]}
            for name, low, high, lower, upper in design.joints_needed
        },
        'reachable': {
            'squares': span(squares),
            'together_um_urad': span(1e6 * together),
            'worst_signs_um_urad': span(1e6 * worst),
        },
        'pareto': {
            'l_mm': 1e3 * front.l2,
            'k_mm': 1e3 * front.k10,
            'f1': front.f1,
            'f2': front.f2,
            'size_mm': 1e3 * front.size,
        },
        'against_finite_differences': result.differences,
    }
