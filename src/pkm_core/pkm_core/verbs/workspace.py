"""`pkm workspace`: extremes, volume and shape of the workspace of a machine."""

from typing import Annotated

import numpy as np
import typer

from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.options import (
    JsonOption,
    MachineOption,
    OutOption,
    OverwriteOption,
    SeedOption,
    finite,
    out_folder,
    write_figures,
)


def workspace(
    machine_name: MachineOption = 'four_dof',
    samples: Annotated[
        int, typer.Option(min=1000, help='Number of Monte-Carlo samples of the joint positions.')
    ] = 1_000_000,
    slice_height: Annotated[float, typer.Option(callback=finite, help='Height of a slice, Zd of (3.30) [mm].')] = 0.4,
    cell: Annotated[
        float, typer.Option(callback=finite, help='Side of a cell of the grid table, rx = ry of (3.31) [mm].')
    ] = 0.5,
    orientation: Annotated[
        float, typer.Option(callback=finite, help='phi of the constant-orientation workspace [deg].')
    ] = -45.0,
    dexterous: Annotated[
        tuple[float, float],
        typer.Option(callback=finite, help='Range of phi that a dexterous position must reach [deg].'),
    ] = (-47.0, -43.0),
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Compute the workspace of a machine: extremes, volume by several methods, constant-orientation and dexterous part.

    Writes Fig. 3.1-3.9 of the thesis and the envelope as STL and PLY files [mm] into --out.

    Example: `pkm workspace --out runs/workspace`

    Example: `pkm workspace --machine planar` prints Table 7.5 beside the computed box.
    """
    from pkm_core.design.workspace_study import Volume, box_against_thesis, exact_volume, monte_carlo, study_spatial

    console, machine, out = Output(), load_machine(machine_name).drawing, out_folder(out)
    spatial = None
    with progress_bar(console, 7) as bar:
        bar.step('Monte-Carlo samples and slices')
        run = monte_carlo(machine, samples, 1e-3 * slice_height, 1e-3 * cell, seed)
        if machine.config.mechanism == 'four_dof':
            spatial = study_spatial(machine, run, np.radians(orientation), tuple(np.radians(dexterous)), seed, bar.step)
            unit, volumes = 'mm^3', spatial.volumes
        else:
            exact = Volume(exact_volume(machine, seed).value)
            cells = Volume(run.slices.projected_area())
            unit, volumes = 'mm^2', {'exact: integral of abs(det J)': exact, f'{cell:g} mm cells, occupied': cells}
        if out:
            bar.step('figures')
            _draw(out, machine, run, spatial)
    ours, thesis = box_against_thesis(machine)
    figures = _figures(machine, run, samples, unit, volumes, spatial) | {'box_mm': ours, 'box_thesis_mm': thesis}
    console.print(_extremes_table(figures))
    console.print(_volumes_table(figures))
    if thesis:
        console.print(f'box in x, y: {ours[0]:.4g} x {ours[1]:.4g} mm; Table 7.5: {thesis[0]:g} x {thesis[1]:g} mm')
    console.print(f'{samples} samples mapped, sliced and outlined in {run.seconds:.2f} s')
    write_figures(json_file, figures)
    if out:
        console.plain(f'figures and surfaces are in {out}')


def _draw(out, machine, run, spatial):
    from pkm_core.design import workspace_figures as draw

    if spatial is None:
        draw.draw_planar(out, machine, run)
        return
    draw.draw_surfaces(out, spatial.tessellation, spatial.joined)
    draw.draw_grid_table(out, run)
    draw.draw_contours(out, run)
    draw.draw_exact_against_cells(out, machine, run)
    for name, mesh in (('contours', spatial.joined), ('envelope', spatial.envelope)):
        for suffix in ('stl', 'ply'):
            mesh.export(out / f'{name}.{suffix}')


def _figures(machine, run, samples, unit, volumes, spatial):
    from pkm_core.design.workspace_study import extreme_figures

    scale = {'mm^3': 1e9, 'mm^2': 1e6}[unit]
    figures = {
        'machine': machine.name,
        'samples': samples,
        'cell_mm': 1e3 * run.slices.cell,
        'slices': len(run.slices.occupied),
        'monte_carlo_seconds': run.seconds,
        'extremes': extreme_figures(machine),
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
    rows: list = []
    for name, row in figures['extremes'].items():
        for end in ('lowest', 'highest'):
            joints = '  '.join(f'{value:8.4f}' for value in row[f'joints_{end}_mm'])
            label = f'{name} [{row["unit"]}]' if end == 'lowest' else ''
            rows.append((label, end, f'{row[end]:.4f}', joints))
        rows.append(None)
    headings = ['coordinate', '', 'reached', 'at joints [mm]']
    return table(f'what {figures["machine"]} reaches', headings, rows, align='llrl')


def _volumes_table(figures):
    rows = []
    for name, row in figures['volumes'].items():
        spread = f'+- {row["error"]:.2g}' if 'error' in row else ''
        if 'least' in row:
            spread = f'{row["least"]:.0f} to {row["value"]:.0f}'
        rows.append((name, f'{row["value"]:.1f}', spread))
    return table('size of the workspace', ['method', figures['unit'], 'uncertainty'], rows)
