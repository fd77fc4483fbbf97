"""`pkm convergence`: how fast a learning law converges, and on which models it would not."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pkm_core.learning import law_names, untested_law
from pkm_core.machines import load_machine
from pkm_core.verbs.options import JsonOption, MachineOption, OutOption, folder, write_json


def convergence(
    machine: MachineOption = 'four_dof',
    law: Annotated[str, typer.Option(help=f'Learning law: {", ".join(law_names())}; or a YAML file.')] = 'fourier',
    control: Annotated[
        str, typer.Option(help="Gains: file of config/control or a YAML file; '' is the machine's own.")
    ] = '',
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Tell by what factor a learning law changes the error from cycle to cycle, on the model and on all perturbed ones.

    Above 1 at any frequency it diverges, however slowly, and refuses to start. Nothing is simulated: config/model,
    config/control and config/learning say it all.

    Example: `pkm convergence --law fourier --control four_dof_thesis --out runs/convergence`
    """
    from pkm_core.control.robust import load_control
    from pkm_core.learning.convergence_report import convergence_figures, convergence_table, plot_convergence

    console, model, out = Console(), load_machine(machine), folder(out)
    figures = convergence_figures(untested_law(law, model, load_control(model, control or None)))
    loops = Path(control or model.name).stem
    title = f'learning law {law} on the loops of {loops}'
    refused = [joint for joint, row in figures.items() if not row['converges']]
    write_json(json_file, {'machine': model.name, 'control': loops, 'law': law, 'joints': figures})
    console.print(convergence_table(title, figures))
    console.print(f'refuses to start: diverges on {", ".join(refused)}' if refused else 'converges on all models')
    if out:
        path = out / f'convergence_{loops}_{law}.png'
        plot_convergence(title, figures, path)
        console.print(f'figure: {path}', soft_wrap=True)
