"""`pkm open-loop`: the machine under sine forces, without control."""

from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pkm_core.machines import load_machine
from pkm_core.verbs.options import JsonOption, MachineOption, OutOption, SeedOption, folder, progress, write_json


def open_loop(
    machine: MachineOption = 'four_dof',
    environment: Annotated[
        str | None,
        typer.Option(
            help='Also the whole simulated machine: ideal, nominal, hard, elastic, or any section of its truth.'
        ),
    ] = None,
    belts: Annotated[
        float | None, typer.Option(min=1.0, help='Also the full model with belts of this stiffness kb [N m/rad].')
    ] = None,
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Play the four sine force cases (5.22)-(5.25) on the rigid machine without losses, and on what else is asked for.

    Writes joints and end point over time as picture and CSV, a pair for each case, into --out (Fig. 5.6-5.11).

    Example: `pkm open-loop --environment nominal --out runs/open_loop`

    Example: `pkm open-loop --belts 100` shows how far belts let the platforms turn and the end point move.
    """
    from pkm_core.experiments.open_loop import CASES, integrate, play
    from pkm_core.experiments.open_loop_report import REFERENCE, draw, draw_belts, figures, write_csv

    console, model, out = Console(), load_machine(machine), folder(out)
    responses, results = {}, {}
    with progress(console, len(CASES)) as step:
        for name, case in CASES.items():
            step(f'case {case.title}')
            responses[name] = {'rigid': integrate(model, case)}
            if belts is not None:
                responses[name]['belts'] = integrate(model, case, belts)
            if environment is not None:
                responses[name][environment] = play(model, case, seed, environment)
            results[name] = {kind: figures(model, case, each) for kind, each in responses[name].items()}
            if model.name == 'four_dof':
                results[name] = {'reference': REFERENCE[name], **results[name]}
            if out:
                draw(out, name, model, case, responses[name])
                bending = {kind: each for kind, each in responses[name].items() if each.belts is not None}
                if bending:
                    draw_belts(out, name, model, case, bending)
                for kind, each in responses[name].items():
                    write_csv(out / f'open_loop_{name}_{kind}.csv', model, each)
    write_json(json_file, {'machine': model.name, 'seed': seed, 'belt_stiffness': belts, 'cases': results})
    console.print(_table('two periods from rest at home; amplitude about the drift', results, CASES, JOINTS))
    console.print(_table('end point', results, CASES, END_POINT))
    bent = {name: {kind: row for kind, row in rows.items() if 'belts' in row} for name, rows in results.items()}
    if any(bent.values()):
        console.print(
            _table('belts: largest turn of a platform and shift of the end point, and 0.1 s later', bent, CASES, BELTS)
        )
    for name, rows in results.items():
        for kind, row in rows.items():
            if row.get('fault'):
                console.print(f'{CASES[name].title} {kind}: {row["fault"]}', soft_wrap=True)
    if out:
        console.print(f'figures and CSV are in {out}', soft_wrap=True)


def _table(title, results, cases, columns):
    """Return a table with a row for each case and model; `columns` maps headings to a function of the figures."""
    table = Table(title=title, title_justify='left')
    for heading in ('case', 'model', *columns):
        table.add_column(heading, no_wrap=True)
    for name, rows in results.items():
        for number, (kind, row) in enumerate(rows.items()):
            cells = (cell(row) for cell in columns.values())
            table.add_row('' if number else cases[name].title, kind, *cells, end_section=number == len(rows) - 1)
    return table


def _row(key):
    return lambda row: ''.join(f'{value:6.2f}' for value in row[key])


def _left(row):
    if row['leaves_travel_s'] is None:
        return 'never'
    return f'{1e3 * row["leaves_travel_s"]:.1f} ms {row.get("leaves_travel_joint") or ""}'


JOINTS = {'net d1, d3, d5, d7 \\[mm]': _row('net_mm'), 'amplitude \\[mm]': _row('amplitude_mm')}
END_POINT = {'span of x, y, z \\[mm], phi \\[deg]': _row('span_mm_deg'), 'leaves its travel': _left}
BELTS = {
    heading: lambda row, key=key: f'{row["belts"][key]:.4f}'
    for heading, key in (
        ('turn \\[deg]', 'largest_turn_deg'),
        ('at rest', 'turn_at_rest_deg'),
        ('shift \\[um]', 'largest_shift_um'),
        ('at rest ', 'shift_at_rest_um'),
    )
}
