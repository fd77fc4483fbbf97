"""`pkm tolerance`: end-point errors caused by errors of the link lengths; chapter 4 of the thesis beside our values."""

from typing import Annotated, NamedTuple

import typer

from pkm_core.machines import load_machine
from pkm_core.verbs.completion import names_of
from pkm_core.verbs.console import Output, progress_bar
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


class Result(NamedTuple):
    """What `tolerance` computes; the types are those of `pkm_core.design`."""

    study: object  # objectives, designs and error statistics of the thesis's tables
    design: object  # the machine's own link lengths on the operational workspace
    reachable: tuple  # squares, errors together, errors with the worst signs, over all reachable positions
    front: object  # Pareto front of f1, f2 and size
    differences: dict  # {error matrix: largest difference (4,) from finite differences}


def tolerance(
    machine_name: MachineOption = 'four_dof',
    workspace: Annotated[
        str,
        typer.Option(autocompletion=names_of('design'), help='Operational workspace of config/design, or a YAML file.'),
    ] = 'chapter4',
    arm: Annotated[
        float,
        typer.Option(min=1e-3, callback=finite, help='Radius that converts angles to lengths [mm]; the thesis uses 1.'),
    ] = 1.0,
    samples: Annotated[
        int, typer.Option(min=1000, help='Number of positions over all that the machine reaches.')
    ] = 100_000,
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Optimise the link lengths l and k against manufacturing errors; print Tables 4.1-4.5 beside those of the thesis.

    Every value is computed with two error matrices: em_thesis, which the thesis's tables stand on, and em_true, which
    is correct. --machine takes your own link lengths, --workspace your own poses, bounds and initial design.

    Example: `pkm tolerance --out runs/tolerance`

    Example: `pkm tolerance --machine my_machine.yaml --workspace my_workspace.yaml --arm 50`
    """
    from pkm_core.design.operational_workspace import load_operational_workspace
    from pkm_core.verbs.tolerance_tables import figures

    console, machine, out = Output(), load_machine(machine_name).drawing, out_folder(out)
    result = _compute(console, machine, load_operational_workspace(workspace), arm, samples, seed, out)
    # the thesis printed its tables for this workspace and this arm
    _print(console, machine, result, printed=workspace == 'chapter4' and arm == 1.0)
    write_figures(json_file, figures(machine, workspace, arm, result))
    if out:
        console.plain(f'figures are in {out}')


def _compute(console, machine, W, arm, samples, seed, out):
    """Return the `Result`; `arm` is in mm, and figures are drawn into `out` if it is not None."""
    from pkm_core.design.objectives import reachable_magnification
    from pkm_core.design.optimisation import pareto_front
    from pkm_core.design.tolerance_study import against_differences, design_on_workspace, study_tolerance

    with progress_bar(console, 15) as bar:
        design = design_on_workspace(machine, W, 1e-3 * arm)
        study = study_tolerance(W, 1e-3 * arm, bar.step)
        bar.step('all that the machine reaches')
        differences = against_differences(machine, seed)
        reachable = reachable_magnification(machine, samples, seed, 1e-3 * arm)
        bar.step('Pareto front')
        front = pareto_front(W, W.workspace.poses(), arm=1e-3 * arm)
        if out:
            from pkm_core.design.tolerance_figures import draw_norms, draw_objectives, draw_pareto

            bar.step('figures')
            draw_objectives(out, W, study, 1e-3 * arm)
            draw_norms(out, W, study, 1e-3 * arm)
            draw_pareto(out, front, machine, design)
    return Result(study, design, reachable, front, differences)


def _print(console, machine, result, printed):
    """Print the tables; `printed`: whether the thesis's values belong to the options."""
    from pkm_core.verbs.tolerance_tables import design_table, objectives_table, reachable_table, statistics_table

    study, front = result.study, result.front
    console.print(objectives_table(study, printed))
    for title in study.designs:
        console.print(statistics_table(title, study, printed))
    console.print(design_table(machine, result.design))
    console.print(reachable_table(machine, result.reachable))
    x, y, z, _ = result.differences['thesis']
    console.print(
        'Largest difference from finite differences of the mechanism: '
        f'em_true {result.differences["true"][:3].max():.1e} in x, y, z; '
        f'em_thesis {max(x, y):.1e} in x, y and {z:.2f} in z'
    )
    console.print(
        f'Pareto front of f1, f2 and size: {len(front.size)} designs, {1e3 * front.size[0]:.1f} mm with f1 = '
        f'{front.f1[0]:.3g}, f2 = {front.f2[0]:.3g} to {1e3 * front.size[-1]:.1f} mm with f1 = {front.f1[-1]:.4g}, '
        f'f2 = {front.f2[-1]:.4g}'
    )
