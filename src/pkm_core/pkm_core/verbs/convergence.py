"""`pkm convergence`: convergence factor of a learning law on the nominal and the perturbed models."""

import typer

from pkm_core.control.controllers import find_control
from pkm_core.learning import untested_law
from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output
from pkm_core.verbs.options import (
    ControllerOption,
    JsonOption,
    LawOption,
    LearningTargetOption,
    MachineOption,
    OutOption,
    OverwriteOption,
    out_folder,
    robust_gains,
    write_figures,
)


def convergence(
    machine_name: MachineOption = 'four_dof',
    law: LawOption = 'fourier',
    controller: ControllerOption = 'robust',
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
    learning_target: LearningTargetOption = 'joints',
):
    """
    Compute the factor by which a learning law multiplies the error per cycle, on the model and on all perturbed models.

    A law with a factor above 1 at any frequency diverges, and a cell refuses to start it. Nothing is simulated: the
    factor follows from config/model, config/control and config/learning. With the learning target `tool`, the reference
    learned at the tool is tested together with the law. The exit code is 1 if a cell refuses the law.

    Example: `pkm convergence --law fourier --controller four_dof_thesis --out runs/convergence`

    Example: `pkm convergence --law inverse --learning-target tool`
    """
    from pkm_core.learning.convergence_report import convergence_figures, convergence_table, plot_convergence
    from pkm_core.learning.tool_convergence import check_tool_law
    from pkm_core.learning.tool_law import load_tool_law

    console, machine, out = Output(), load_machine(machine_name), out_folder(out)
    of_joints = untested_law(law, machine, robust_gains(machine, controller))
    figures = convergence_figures(of_joints)
    loops = find_control(machine, controller)[1].stem
    title = f'learning law {law} on the loops of {loops}'
    refused = [joint for joint, row in figures.items() if not row['converges']]
    console.print(convergence_table(title, figures))
    console.print(f'diverges on {", ".join(refused)}: refused by the cell' if refused else 'converges on all models')
    write_figures(json_file, {'machine': machine.name, 'control': loops, 'law': law, 'joints': figures})
    if learning_target == 'tool':
        config = load_tool_law(machine)
        console.plain(check_tool_law(config, machine, of_joints.gains, of_joints.models, of_joints))
    if out:
        path = out / f'convergence_{loops}_{law}.png'
        plot_convergence(title, figures, path)
        console.plain(f'figure: {path}')
    if refused:
        raise typer.Exit(1)
