"""`pkm identify`: find the models of a machine's axes by moving it."""

from typing import Annotated

import typer
from rich.console import Console

from pkm_core.machines import load_machine
from pkm_core.verbs.design_output import JsonOption, MachineOption, OutOption, SeedOption, folder, progress, write_json


def identify(
    machine: MachineOption = 'four_dof',
    joint: Annotated[list[str] | None, typer.Option(help='Axis to identify, repeatable; all by default.')] = None,
    seed: SeedOption = 1,
    environment: Annotated[str, typer.Option(help='How rough the world is: a section of config/truth.')] = 'nominal',
    band: Annotated[tuple[float, float], typer.Option(help='The swept sine [Hz].')] = (80.0, 500.0),
    control: Annotated[
        str, typer.Option(help="Gains that run meanwhile: of config/control, or a YAML file; '' is the machine's.")
    ] = '',
    modes: Annotated[
        int | None, typer.Option(min=1, max=5, help='Resonances of an axis; as many as its model has by default.')
    ] = None,
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Identify P = K/(s (s + a)) H(s) of every axis on the simulated machine, without ROS.

    Slow moves give K and a, a swept sine during a jog the resonances, both in closed loop and without bias. Writes
    model.yaml, a file for config/model, and Fig. 7.9-7.12 (8.4-8.11) of the thesis into --out.

    Example: `pkm identify --machine planar --out runs/identified`
    """
    from pkm_core.control.model import load_model
    from pkm_core.control.robust import load_control
    from pkm_core.identification.excitation import experiments
    from pkm_core.identification.figures import draw_identification
    from pkm_core.identification.identify import identify_joint
    from pkm_core.identification.loop import SimulatedCell
    from pkm_core.identification.model_file import write_model
    from pkm_core.identification.summary import as_figures, show
    from pkm_core.identification.sweep import Sweep

    console, system, out = Console(), load_machine(machine), folder(out)
    believed, gains = load_model(system), load_control(system, control or None)
    plans = {  # all are checked before anything moves
        name: experiments(system, name, believed, gains, Sweep(band=band)) for name in joint or system.joints
    }
    cell = SimulatedCell(system, gains, seed, environment)
    found = {}
    with progress(console, sum(len(plan) + 1 for plan in plans.values())) as step:
        for name, plan in plans.items():
            records = []
            for experiment in plan:
                step(experiment.name)
                records.append(cell.run(experiment))
            step(f'{name}: fit')
            found[name] = identify_joint(system, name, records, believed, gains, band=band, modes=modes)
    show(console, f'{system.name}, seed {seed}, {environment}', found)
    write_json(json_file, {
        'machine': system.name, 'seed': seed, 'environment': environment, 'band_Hz': band,
        'ticks': sum(len(experiment.trajectory) for plan in plans.values() for experiment in plan),
        'axes': as_figures(found),
    })  # fmt: skip
    if out:
        origin = f'pkm identify --machine {machine} --seed {seed} --environment {environment}'
        write_model(out / 'model.yaml', system, found, believed, origin)
        draw_identification(out, system, found)
        console.print(f'model.yaml and figures are in {out}', soft_wrap=True)
