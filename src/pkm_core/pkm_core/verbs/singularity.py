"""`pkm singularity`: proof that the travel has no singular position, and the conditioning of the Jacobian."""

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
    finite,
    out_folder,
    write_figures,
)


def singularity(
    machine_name: MachineOption = 'four_dof',
    tolerance: Annotated[
        float,
        typer.Option(
            min=1e-4,
            max=0.5,
            callback=finite,
            help='Largest relative gap between a proven bound and the attained value.',
        ),
    ] = 0.01,
    length: Annotated[
        float, typer.Option(min=1e-3, callback=finite, help='Radius that converts angles to lengths [mm].')
    ] = 50.0,
    samples: Annotated[
        int, typer.Option(min=1000, help='Number of positions for the maps and the condition number.')
    ] = 200_000,
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Prove by interval arithmetic that the travel has no singular position; map determinant and condition number.

    Example: `pkm singularity --out runs/singularity`
    """
    import numpy as np

    from pkm_core.design.singularity import certificate, conditioning
    from pkm_core.design.workspace import sample_joints

    console, machine, out = Output(), load_machine(machine_name).drawing, out_folder(out)
    with progress_bar(console, 3) as bar:
        bar.step('proof over boxes of joint positions')
        bounds = certificate(machine, tolerance)
        bar.step('conditioning')
        q = sample_joints(machine, samples, seed)
        determinant = np.linalg.det(machine.jacobian(q))
        condition = conditioning(machine, q, 1e-3 * length)
        if out:
            from pkm_core.design.singularity_figures import draw_factors, draw_maps

            bar.step('maps')
            draw_maps(out, machine.forward(q), determinant, condition, 1e-3 * length)
            if machine.config.mechanism == 'four_dof':
                draw_factors(out, machine)
    figures = {
        'machine': machine.name,
        'proven_regular': True,
        'certificate': {name: bound._asdict() for name, bound in bounds.items()},
        'boxes': sum(bound.boxes for bound in bounds.values()),
        'determinant_sampled': [determinant.min(), determinant.max()],
        'determinant_home': np.linalg.det(machine.jacobian(machine.home)),
        'condition_sampled': {'least': condition.min(), 'median': np.median(condition), 'worst': condition.max()},
        'angles_at_mm': length,
        'samples': samples,
    }
    rows = []
    for name, bound in bounds.items():
        scale, unit = (1.0, '') if name == 'abs(det J)' else (1e3, ' mm')
        proven = np.floor(1e5 * scale * bound.proven) / 1e5  # a bound is not rounded up
        rows.append((name, f'{proven:.5f}{unit}', f'{scale * bound.attained:.5f}{unit}', str(bound.boxes)))
    headings = ['quantity', 'proven above', 'attained', 'boxes']
    console.print(table(f'{machine.name}: lower bounds over the whole travel', headings, rows))
    console.print(f'No singular position within the travel: proven with {figures["boxes"]} boxes.')
    console.print(
        f'{samples} samples: det J {determinant.min():.4g} to {determinant.max():.4g} (SI), condition number '
        f'{condition.min():.2f} to {condition.max():.1f}, median {np.median(condition):.1f}, angles at {length:g} mm'
    )
    write_figures(json_file, figures)
    if out:
        console.plain(f'figures are in {out}')
