"""`pkm identify`: find the models of a machine's axes by moving it."""

from typing import Annotated

import typer
from rich.console import Console

from pkm_core.identification.plan import POSITIONS, Request, plan
from pkm_core.identification.sweep import Sweep
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

# what is asked of the axes, in the graph and without it
JointsOption = Annotated[list[str] | None, typer.Option(help='Axis to identify, repeatable; all by default.')]
PositionsOption = Annotated[int, typer.Option(min=1, help='Places of the motor pair that the sweep visits.')]
BandOption = Annotated[tuple[float, float], typer.Option(help='The swept sine [Hz].')]
VoltageOption = Annotated[float, typer.Option(callback=finite, help='Largest amplitude of the swept sine [V].')]
JogOption = Annotated[
    float, typer.Option(callback=finite, help='Speed of the jog under the sweep [mm/s]; its stroke grows with it.')
]
StrokeOption = Annotated[
    float, typer.Option(callback=finite, help="Stroke of the slow moves [mm]; 0 takes the thesis's, 4 to 10 mm.")
]
BAND, VOLTAGE, JOG = Sweep().band, Sweep().voltage, 1e3 * Sweep().speed


def identify(
    machine: MachineOption = 'four_dof',
    joint: JointsOption = None,
    seed: SeedOption = 1,
    environment: Annotated[str, typer.Option(help='How rough the world is: a section of config/truth.')] = 'nominal',
    positions: PositionsOption = POSITIONS,
    band: BandOption = BAND,
    voltage: VoltageOption = VOLTAGE,
    jog: JogOption = JOG,
    stroke: StrokeOption = 0.0,
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
    from pkm_core.identification.figures import draw_identification
    from pkm_core.identification.identify import identify_joint
    from pkm_core.identification.model_file import write_model
    from pkm_core.identification.summary import as_figures, show
    from pkm_core.simulation.experiment import SimulatedCell

    console, system, out = Console(), load_machine(machine), folder(out)
    believed, gains = load_model(system), load_control(system, control or None)
    request = Request(tuple(joint or ()), 'both', positions, band, voltage, 1e-3 * jog, 1e-3 * stroke)
    plans = plan(system, request, believed, gains)
    cell = SimulatedCell(system, gains, seed, environment)
    found = {}
    with progress(console, sum(len(of_axis) + 1 for of_axis in plans.values())) as step:
        for name, of_axis in plans.items():
            records = []
            for experiment in of_axis:
                step(experiment.name)
                records.append(cell.run(experiment))
            step(f'{name}: fit')
            found[name] = identify_joint(system, name, records, believed, gains, band=band, modes=modes)
    show(console, f'{system.name}, seed {seed}, {environment}', found)
    write_json(json_file, {
        'machine': system.name, 'seed': seed, 'environment': environment, 'band_Hz': band,
        'ticks': sum(len(experiment.trajectory) for of_axis in plans.values() for experiment in of_axis),
        'axes': as_figures(found),
    })  # fmt: skip
    if out:
        origin = f'pkm identify --machine {machine} --seed {seed} --environment {environment}'
        write_model(out / 'model.yaml', system, found, believed, origin)
        draw_identification(out, system, found)
        console.print(f'model.yaml and figures are in {out}', soft_wrap=True)
