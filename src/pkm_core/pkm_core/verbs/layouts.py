"""`pkm layouts`: linkage modules and layouts of chapter 2 beside each other."""

from typing import Annotated

import typer

from pkm_core.machines import load_machine
from pkm_core.verbs.completion import names_of
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.options import (
    JsonOption,
    OutOption,
    OverwriteOption,
    SeedOption,
    finite,
    out_folder,
    write_figures,
)


def layouts(
    machine_names: Annotated[
        list[str] | None,
        typer.Option(
            '--machine',
            autocompletion=names_of('machines'),
            help='Machine of config/machines, or a YAML file.',
        ),
    ] = None,
    samples: Annotated[
        int, typer.Option(min=1000, help='Number of joint positions for conditioning and sensitivity.')
    ] = 100_000,
    length: Annotated[
        float, typer.Option(min=1e-3, callback=finite, help='Radius that converts angles to lengths [mm].')
    ] = 50.0,
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Compare linkage modules and layouts: base area, workspace, conditioning, travel, error per um of link error.

    Those of chapter 2 of the thesis; --machine, repeatable, names others.

    Example: `pkm layouts --out runs/layouts`

    Example: `pkm layouts --machine planar --machine my_linkage.yaml`
    """
    from pkm_core.design.layouts import COMPARED, compare

    console, out = Output(), out_folder(out)
    machines = [load_machine(name).drawing for name in machine_names or COMPARED]
    with progress_bar(console, len(machines) + 1) as bar:
        found = compare(machines, samples, seed, 1e-3 * length, bar.step)
        if out:
            from pkm_core.design.layout_figures import draw_layouts

            bar.step('figure')
            draw_layouts(out, machines, found, seed)
    figures = {name: _figures(machine, found[machine.name]) for name, machine in zip(found, machines, strict=True)}
    for spatial in (False, True):
        rows = {name: row for name, row in figures.items() if ('phi' in row['coordinates']) == spatial}
        if rows:
            console.print(_table(rows, spatial, length))
            console.print(_sensitivities(rows, spatial))
    write_figures(json_file, {'samples': samples, 'seed': seed, 'angles_at_mm': length, 'machines': figures})
    if out:
        console.plain(f'the figure is in {out}')


def _figures(machine, found):
    """Return the figures of one machine by name, in mm, um and mdeg."""
    import numpy as np

    spatial = found.orientation is not None
    scale = 1e9 if spatial else 1e6
    figures = {
        'title': found.title,
        'coordinates': list(machine.coordinates),
        'base_mm': [1e3 * side for side in found.base],
        'base_mm2': 1e6 * found.area,
        'workspace_mm3' if spatial else 'workspace_mm2': scale * found.workspace.value,
        'workspace_error': scale * found.workspace.error,
        'condition_home': found.condition[0],
        'condition_worst': found.condition[1],
        'conditioning_index': found.conditioning,
        'task_travel_mm': dict(zip(machine.joints, 1e3 * found.travel, strict=True)),
        'position_um_per_um': dict(zip(('mean', 'worst'), found.position, strict=True)),
    }
    if spatial:
        turn = np.degrees(1.0) * 1e-3  # rad/m to mdeg/um
        figures['phi_mdeg_per_um'] = {k: turn * v for k, v in zip(('mean', 'worst'), found.orientation, strict=True)}
    return figures


def _table(rows, spatial, length):
    size, unit = ('workspace_mm3', 'mm^3') if spatial else ('workspace_mm2', 'mm^2')
    title = 'layouts' if spatial else 'linkage modules'
    angles = f', angles at {length:g} mm' if spatial else ''
    ratio = '1/mm' if spatial else 'mm^2/mm^2'
    headings = ['machine', title, 'base [mm]', 'base [cm^2]', f'workspace [{unit}]', f'base/workspace [{ratio}]']
    headings += ['condition: home', 'worst', 'mean of inverse']
    cells = [
        (
            name,
            row['title'],
            '{:.1f} x {:.1f}'.format(*row['base_mm']),
            f'{1e-2 * row["base_mm2"]:.1f}',
            f'{row[size]:.0f}' + (f' +- {row["workspace_error"]:.0f}' if spatial else ''),
            f'{row["base_mm2"] / row[size]:.1f}',
            f'{row["condition_home"]:.2f}',
            f'{row["condition_worst"]:.1f}',
            f'{row["conditioning_index"]:.3f}',
        )
        for name, row in rows.items()
    ]
    return table(f'{title}{angles}', headings, cells, align='llr')


def _sensitivities(rows, spatial):
    from pkm_core.design.layouts import TASK

    headings = ['machine', 'travel [mm]', 'position [um/um]: mean', 'worst']
    headings += ['phi [mdeg/um]: mean', 'worst'] if spatial else []
    cells = []
    for name, row in rows.items():
        values = [*row['position_um_per_um'].values(), *row.get('phi_mdeg_per_um', {}).values()]
        travel = max(row['task_travel_mm'].values())
        cells.append((name, f'{travel:.1f}', *(f'{value:.2f}' for value in values)))
    reach = f'x, y +-{1e3 * TASK["x"]:g} mm' + (f', z +-{1e3 * TASK["z"]:g} mm, phi +-3 deg' if spatial else '')
    return table(f'longest travel for {reach} about home; root sum square of errors of all links', headings, cells)
