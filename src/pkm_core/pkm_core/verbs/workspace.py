"""`pkm workspace`: what a machine reaches."""

from typing import Annotated

import numpy as np
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


def workspace(
    machine: MachineOption = 'four_dof',
    samples: Annotated[int, typer.Option(min=1000, help='Monte-Carlo samples of the joints.')] = 1_000_000,
    slice_height: Annotated[
        float, typer.Option(callback=finite, help='Wanted height of a slice, Zd of (3.30) [mm].')
    ] = 0.4,
    cell: Annotated[
        float, typer.Option(callback=finite, help='Side of a cell of the grid table, rx = ry of (3.31) [mm].')
    ] = 0.5,
    orientation: Annotated[
        float, typer.Option(callback=finite, help='phi of the constant-orientation workspace [deg].')
    ] = -45.0,
    dexterous: Annotated[
        tuple[float, float], typer.Option(callback=finite, help='Every phi between these must be reached [deg].')
    ] = (-47.0, -43.0),
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Tell what a machine reaches: extremes, volume by several methods, constant-orientation and dexterous workspace.

    Writes Fig. 3.1-3.9 of the thesis and the envelope as STL and PLY [mm] into --out.

    Example: `pkm workspace --out runs/workspace`

    Example: `pkm workspace --machine planar` checks Table 7.5.
    """
    from pkm_core.design.workspace_study import Volume, box_against_thesis, exact_volume, monte_carlo, study_spatial

    console, model, out = Console(), load_machine(machine).drawing, folder(out)
    spatial = None
    with progress(console, 7) as step:
        step('Monte-Carlo samples and slices')
        run = monte_carlo(model, samples, 1e-3 * slice_height, 1e-3 * cell, seed)
        if model.config.mechanism == 'four_dof':
            spatial = study_spatial(model, run, np.radians(orientation), tuple(np.radians(dexterous)), seed, step)
            unit, volumes = 'mm^3', spatial.volumes
        else:
            exact = Volume(exact_volume(model, seed).value)
            cells = Volume(run.slices.projected_area())
            unit, volumes = 'mm^2', {'exact: integral of abs(det J)': exact, f'{cell:g} mm cells, occupied': cells}
        if out:
            step('figures')
            _draw(out, model, run, spatial)
    ours, thesis = box_against_thesis(model)
    figures = _figures(model, run, samples, unit, volumes, spatial) | {'box_mm': ours, 'box_thesis_mm': thesis}
    write_json(json_file, figures)
    console.print(_extremes_table(figures))
    console.print(_volumes_table(figures))
    if thesis:
        console.print(f'box in x, y: {ours[0]:.4g} x {ours[1]:.4g} mm; Table 7.5: {thesis[0]:g} x {thesis[1]:g} mm')
    console.print(f'{samples} samples mapped, sliced and outlined in {run.seconds:.2f} s')
    if out:
        console.print(f'figures and surfaces are in {out}', soft_wrap=True)


def _draw(out, model, run, spatial):
    from pkm_core.design import workspace_figures as draw

    if spatial is None:
        draw.draw_planar(out, model, run)
        return
    draw.draw_surfaces(out, spatial.tessellation, spatial.joined)
    draw.draw_grid_table(out, run)
    draw.draw_contours(out, run)
    draw.draw_exact_against_cells(out, model, run)
    for name, mesh in (('contours', spatial.joined), ('envelope', spatial.envelope)):
        for suffix in ('stl', 'ply'):
            mesh.export(out / f'{name}.{suffix}')


def _figures(model, run, samples, unit, volumes, spatial):
    from pkm_core.design.workspace_study import extreme_figures

    scale = {'mm^3': 1e9, 'mm^2': 1e6}[unit]
    figures = {
        'machine': model.name,
        'samples': samples,
        'cell_mm': 1e3 * run.slices.cell,
        'slices': len(run.slices.occupied),
        'monte_carlo_seconds': run.seconds,
        'extremes': extreme_figures(model),
        'unit': unit,
        'volumes': {
            name: {key: scale * value for key, value in volume._asdict().items() if value is not None}
            for name, volume in volumes.items()
        },
        'projected_area_mm2': 1e6 * run.slices.projected_area(),
    }
    if spatial:
        figures |= {
            'cells_reached_without_sample': spatial.missed,
            'cells_cut_by_the_boundary': spatial.cut,
            'surfaces_closed': spatial.joined.is_watertight and spatial.envelope.is_watertight,
        }
    return figures


def _extremes_table(figures):
    table = Table(title=f'what {figures["machine"]} reaches', title_justify='left')
    for heading in ('coordinate', '', 'reached', 'at joints \\[mm]'):
        table.add_column(heading, justify='right' if heading == 'reached' else 'left')
    for name, row in figures['extremes'].items():
        for end in ('lowest', 'highest'):
            joints = '  '.join(f'{value:8.4f}' for value in row[f'joints_{end}_mm'])
            label = f'{name} \\[{row["unit"]}]' if end == 'lowest' else ''
            table.add_row(label, end, f'{row[end]:.4f}', joints, end_section=end == 'highest')
    return table


def _volumes_table(figures):
    table = Table(title='size of the workspace', title_justify='left')
    table.add_column('method')
    table.add_column(figures['unit'], justify='right')
    table.add_column('uncertainty', justify='right')
    for name, row in figures['volumes'].items():
        spread = f'+- {row["error"]:.2g}' if 'error' in row else ''
        if 'least' in row:
            spread = f'{row["least"]:.0f} to {row["value"]:.0f}'
        table.add_row(name, f'{row["value"]:.1f}', spread)
    return table
