"""`pkm tolerance`: how link lengths magnify manufacturing errors, chapter 4 of the thesis beside ours."""

from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pkm_core.machines import load_machine
from pkm_core.verbs.options import (
    JsonOption,
    MachineOption,
    OutOption,
    SeedOption,
    finite,
    folder,
    progress,
    write_json,
)


def tolerance(
    machine: MachineOption = 'four_dof',
    workspace: Annotated[
        str, typer.Option(help='Operational workspace of config/design, or a YAML file.')
    ] = 'chapter4',
    arm: Annotated[
        float,
        typer.Option(
            min=1e-3, callback=finite, help='Radius on which an angle counts as a length [mm]; 1 is the thesis.'
        ),
    ] = 1.0,
    samples: Annotated[int, typer.Option(min=1000, help='Positions over all that the machine reaches.')] = 100_000,
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Optimise the link lengths l and k against manufacturing errors and regenerate Tables 4.1-4.5 beside the thesis's.

    Every figure comes out of two error matrices: em_thesis, which stands behind the thesis's tables, and em_true, which
    is correct. --machine takes your own link lengths, --workspace your own poses, bounds and initial design.

    Example: `pkm tolerance --out runs/tolerance`

    Example: `pkm tolerance --machine my_machine.yaml --workspace my_workspace.yaml --arm 50`
    """
    from pkm_core.design.objectives import reachable_magnification
    from pkm_core.design.operational_workspace import load_operational_workspace
    from pkm_core.design.optimisation import pareto_front
    from pkm_core.design.tolerance_study import against_differences, design_on_workspace, study_tolerance

    console, model, out = Console(), load_machine(machine).drawing, folder(out)
    W = load_operational_workspace(workspace)
    with progress(console, 15) as step:
        design = design_on_workspace(model, W, 1e-3 * arm)
        study = study_tolerance(W, 1e-3 * arm, step)
        step('all that the machine reaches')
        differences = against_differences(model, seed)
        reachable = reachable_magnification(model, samples, seed, 1e-3 * arm)
        step('Pareto front')
        front = pareto_front(W, W.workspace.poses(), arm=1e-3 * arm)
        if out:
            from pkm_core.design.tolerance_figures import draw_norms, draw_objectives, draw_pareto

            step('figures')
            draw_objectives(out, W, study, 1e-3 * arm)
            draw_norms(out, W, study, 1e-3 * arm)
            draw_pareto(out, front, model, design)
    printed = workspace == 'chapter4' and arm == 1.0  # what the thesis prints belongs to these
    write_json(
        json_file,
        _figures(model, workspace, arm, study, design, reachable, front) | {'against_finite_differences': differences},
    )
    console.print(_objectives_table(study, printed))
    for title in study.designs:
        console.print(_statistics_table(title, study, printed))
    console.print(_design_table(model, design))
    console.print(_reachable_table(model, reachable))
    x, y, z, _ = differences['thesis']
    console.print(
        'Largest difference from finite differences of the mechanism: '
        f'em_true {differences["true"][:3].max():.1e} in x, y, z; em_thesis {max(x, y):.1e} in x, y and {z:.2f} in z'
    )
    console.print(
        f'Pareto front of f1, f2 and size: {len(front.size)} designs, {1e3 * front.size[0]:.1f} mm with f1 = '
        f'{front.f1[0]:.3g}, f2 = {front.f2[0]:.3g} to {1e3 * front.size[-1]:.1f} mm with f1 = {front.f1[-1]:.4g}, '
        f'f2 = {front.f2[-1]:.4g}'
    )
    if out:
        console.print(f'figures are in {out}', soft_wrap=True)


def _table(title, *headings):
    table = Table(title=title, title_justify='left')
    for i, heading in enumerate(headings):
        table.add_column(heading, justify='left' if i == 0 else 'right')
    return table


def _objectives_table(study, printed):
    from pkm_core.thesis.tolerances import OBJECTIVES

    columns = [(variant, grid) for variant in ('thesis', 'true') for grid in ('middle', 'all')]
    headings = [f'em_{variant}\n{grid}' for variant, grid in columns]
    table = _table('Table 4.1; angles of W: the middle one, or all', '', 'thesis', *headings)
    for name, (initial, (l2, k10, value)) in OBJECTIVES.items():
        found = [study.objectives[name, *column] for column in columns]
        rows = (
            (f'{name}, initial', f'{initial:g}', [f'{each.initial:.6g}' for each in found]),
            ('   l \\[mm]', f'{l2:g}', [f'{1e3 * each.optimum.l2:.3f}' for each in found]),
            ('   k \\[mm]', f'{k10:g}', [f'{1e3 * each.optimum.k10:.3f}' for each in found]),
            (f'   {name}, optimum', f'{value:g}', [f'{each.optimum.value:.5g}' for each in found]),
        )
        for label, theirs, ours in rows:
            table.add_row(label, theirs if printed else '', *ours, end_section='optimum' in label)
    return table


def _statistics_table(title, study, printed):
    from pkm_core.thesis.tolerances import ERRORS, STATISTICS

    design = study.designs[title]
    table = _table(
        f'{title}: l = {1e3 * design.l2:.5g} mm, k = {1e3 * design.k10:.6g} mm, links +1 um',
        'error',
        *STATISTICS,
    )
    for name in ('x', 'y', 'z', 'phi'):
        unit = '\\[urad]' if name == 'phi' else '\\[um]'
        if printed:
            theirs = ('' if value is None else f'{value:g}' for value in ERRORS[title][name])
            table.add_row(f'{name} {unit} thesis', *theirs)
        rows = {
            variant: [f'{1e6 * value:z.3f}' for value in study.statistics[title, variant][name]]
            for variant in ('thesis', 'true')
        }
        table.add_row(f'{name} {unit} em_thesis', *rows['thesis'])
        if rows['true'] != rows['thesis']:
            table.add_row(f'{name} {unit} em_true', *rows['true'])
        table.add_section()
    return table


def _design_table(model, design):
    geometry = model.config.geometry
    table = _table(
        f'{model.name} on W, all angles: l = {1e3 * geometry.l2:g} mm, k = {1e3 * geometry.k10:g} mm',
        '',
        'f',
        'f1',
        'f2',
        'size \\[mm]',
    )
    for variant, values in design.values.items():
        numbers = (f'{values[name]:.5g}' for name in ('f', 'f1', 'f2'))
        table.add_row(f'em_{variant}', *numbers, f'{1e3 * values["size"]:.1f}')
    table.caption = 'W asks for ' + ', '.join(
        f'{name} {1e3 * low:.1f} to {1e3 * high:.1f} mm'
        + ('' if low >= lower and high <= upper else f' (travel {1e3 * lower:g} to {1e3 * upper:g})')
        for name, low, high, lower, upper in design.joints_needed
    )
    table.caption_justify = 'left'
    return table


def _reachable_table(model, reachable):
    squares, together, worst = reachable
    table = _table(f'{model.name} over all it reaches, em_true', '', 'least', 'mean', 'most')
    table.add_row(
        'sum of squared singular values', *(f'{v:.3g}' for v in (squares.min(), squares.mean(), squares.max()))
    )
    for title, errors in (('links +1 um', together), ('links +-1 um, worst signs', worst)):
        for name, column in zip(model.coordinates, 1e6 * errors.T, strict=True):
            unit = 'urad' if name == 'phi' else 'um'
            table.add_row(
                f'{title}: {name} \\[{unit}]', *(f'{v:.3g}' for v in (column.min(), column.mean(), column.max()))
            )
    return table


def _figures(model, workspace, arm, study, design, reachable, front):
    squares, together, worst = reachable

    def span(values):
        return {'least': values.min(axis=0), 'mean': values.mean(axis=0), 'most': values.max(axis=0)}

    return {
        'machine': model.name,
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
    }
