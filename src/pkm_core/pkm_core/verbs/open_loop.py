"""`pkm open-loop`: response of the machine to sine forces, without control."""

from typing import Annotated

import typer

from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.options import (
    JsonOption,
    MachineOption,
    OutOption,
    OverwriteOption,
    SeedOption,
    out_folder,
    write_figures,
)


def open_loop(
    machine_name: MachineOption = 'four_dof',
    environment: Annotated[
        str | None,
        typer.Option(
            help='Also simulate the whole machine at this level of imperfections: ideal, nominal, hard, elastic '
            '(four_dof only), or another section of config/truth.'
        ),
    ] = None,
    belts: Annotated[
        float | None,
        typer.Option(min=1.0, help='Also simulate the full model with belts of this stiffness kb [N m/rad].'),
    ] = None,
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Simulate the four sine force cases (5.22)-(5.25) on the rigid machine without losses; options add other models.

    Writes joints and end point over time into --out, one figure and one CSV file per case (Fig. 5.6-5.11). With another
    model beside the rigid one, a figure has the differences of the joints (Fig. 6.11-6.14).

    Example: `pkm open-loop --environment nominal --out runs/open_loop`

    Example: `pkm open-loop --belts 100` prints how far the belts let the platforms turn and the end point move.
    """
    from pkm_core.experiments.open_loop import CASES, integrate, play
    from pkm_core.experiments.open_loop_report import (
        REFERENCE,
        difference_figures,
        draw,
        draw_belts,
        draw_differences,
        figures,
        write_csv,
    )

    console, machine, out = Output(), load_machine(machine_name), out_folder(out)
    responses, results = {}, {}
    with progress_bar(console, len(CASES)) as bar:
        for name, case in CASES.items():
            bar.step(f'case {case.title}')
            responses[name] = {'rigid': integrate(machine, case)}
            if belts is not None:
                responses[name]['belts'] = integrate(machine, case, belts)
            if environment is not None:
                responses[name][environment] = play(machine, case, seed, environment)
            results[name] = {kind: figures(machine, case, each) for kind, each in responses[name].items()}
            for kind, each in responses[name].items():
                if kind != 'rigid':
                    results[name][kind]['difference'] = difference_figures(each, responses[name]['rigid'])
            if machine.name == 'four_dof':
                results[name] = {'reference': REFERENCE[name], **results[name]}
            if out:
                draw(out, name, machine, case, responses[name])
                if len(responses[name]) > 1:
                    draw_differences(out, name, machine, case, responses[name])
                bending = {kind: each for kind, each in responses[name].items() if each.belts is not None}
                if bending:
                    draw_belts(out, name, machine, case, bending)
                for kind, each in responses[name].items():
                    write_csv(out / f'open_loop_{name}_{kind}.csv', machine, each)
    console.print(_table('two periods from rest at home; amplitude about the drift', results, CASES, JOINTS))
    console.print(_table('end point', results, CASES, END_POINT))
    write_figures(json_file, {'machine': machine.name, 'seed': seed, 'belt_stiffness': belts, 'cases': results})
    apart = {name: {kind: row for kind, row in rows.items() if 'difference' in row} for name, rows in results.items()}
    if any(apart.values()):
        console.print(_table('difference of the joints from the rigid model', apart, CASES, DIFFERENCE))
    bent = {name: {kind: row for kind, row in rows.items() if 'belts' in row} for name, rows in results.items()}
    if any(bent.values()):
        console.print(
            _table('belts: largest turn of a platform and shift of the end point, and 0.1 s later', bent, CASES, BELTS)
        )
    for name, rows in results.items():
        for kind, row in rows.items():
            if row.get('fault'):
                console.plain(f'{CASES[name].title} {kind}: {row["fault"]}')
    if out:
        console.plain(f'figures and CSV files are in {out}')


def _table(title, results, cases, columns):
    """Return a table with one row per case and model; `columns` maps headings to functions of the figures."""
    rows: list = []
    for name, of_case in results.items():
        for number, (kind, row) in enumerate(of_case.items()):
            cells = (cell(row) for cell in columns.values())
            rows.append(('' if number else cases[name].title, kind, *cells))
        rows.append(None)
    return table(title, ['case', 'model', *columns], rows, align='l', no_wrap=True)


def _row(key):
    return lambda row: ''.join(f'{value:6.2f}' for value in row[key])


def _left(row):
    if row['leaves_travel_s'] is None:
        return 'never'
    return f'{1e3 * row["leaves_travel_s"]:.1f} ms {row.get("leaves_travel_joint") or ""}'


JOINTS = {'net d1, d3, d5, d7 [mm]': _row('net_mm'), 'amplitude [mm]': _row('amplitude_mm')}
END_POINT = {'span of x, y, z [mm], phi [deg]': _row('span_mm_deg'), 'leaves its travel': _left}
DIFFERENCE = {
    heading: lambda row, key=key: ''.join(f'{value:10.2f}' for value in row['difference'][key])
    for heading, key in (('largest d1, d3, d5, d7 [um]', 'largest_um'), ('root mean square [um]', 'rms_um'))
}
BELTS = {
    heading: lambda row, key=key: f'{row["belts"][key]:.4f}'
    for heading, key in (
        ('turn [deg]', 'largest_turn_deg'),
        ('at rest', 'turn_at_rest_deg'),
        ('shift [um]', 'largest_shift_um'),
        ('at rest ', 'shift_at_rest_um'),
    )
}
