"""`pkm identify`: identify the axis models of the simulated machine, without ROS."""

from typing import Annotated

import typer

from pkm_core.identification.plan import POSITIONS, Request, plan
from pkm_core.identification.sweep import Sweep
from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, progress_bar
from pkm_core.verbs.options import (
    ControllerOption,
    EnvironmentOption,
    JointsOption,
    JsonOption,
    MachineOption,
    ModesOption,
    OutOption,
    OverwriteOption,
    SeedOption,
    finite,
    out_folder,
    robust_gains,
    write_figures,
)

# the experiments, with the same options in the graph and without it
PositionsOption = Annotated[int, typer.Option(min=1, help='Number of positions of the motor pair to sweep at.')]
BandOption = Annotated[tuple[float, float], typer.Option(help='Band of the swept sine [Hz].')]
VoltageOption = Annotated[float, typer.Option(callback=finite, help='Largest amplitude of the swept sine [V].')]
JogOption = Annotated[
    float, typer.Option(callback=finite, help='Speed of the jog during the sweep [mm/s]; its stroke is proportional.')
]
StrokeOption = Annotated[
    float, typer.Option(callback=finite, help='Stroke of the slow moves [mm]; 0: as in the thesis, 4 to 10 mm.')
]
BAND, VOLTAGE, JOG = Sweep().band, Sweep().voltage, 1e3 * Sweep().speed


def identify(
    machine_name: MachineOption = 'four_dof',
    joint: JointsOption = None,
    seed: SeedOption = 1,
    environment: EnvironmentOption = 'nominal',
    positions: PositionsOption = POSITIONS,
    band: BandOption = BAND,
    voltage: VoltageOption = VOLTAGE,
    jog: JogOption = JOG,
    stroke: StrokeOption = 0.0,
    controller: ControllerOption = 'robust',
    modes: ModesOption = None,
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Identify P = K/(s (s + a)) H(s) of every axis on the simulated machine, without ROS.

    Slow moves give K and a; a swept sine during a jog gives the resonances. Both run in closed loop, and the estimates
    are unbiased. Writes model.yaml, a file for config/model, and Fig. 7.9-7.12 (8.4-8.11) of the thesis into --out.

    Example: `pkm identify --machine planar --out runs/identified`
    """
    from pkm_core.control.model import load_model
    from pkm_core.identification.figures import draw_identification
    from pkm_core.identification.identify import identify_joint
    from pkm_core.identification.model_file import write_model
    from pkm_core.identification.summary import as_figures, show
    from pkm_core.simulation.experiment import SimulatedCell

    console, machine, out = Output(), load_machine(machine_name), out_folder(out)
    believed, gains = load_model(machine), robust_gains(machine, controller)
    request = Request(tuple(joint or ()), 'both', positions, band, voltage, 1e-3 * jog, 1e-3 * stroke)
    plans = plan(machine, request, believed, gains)
    cell = SimulatedCell(machine, gains, seed, environment)
    found = {}
    with progress_bar(console, sum(len(of_axis) + 1 for of_axis in plans.values())) as bar:
        for name, of_axis in plans.items():
            records = []
            for experiment in of_axis:
                bar.step(experiment.name)
                records.append(cell.run(experiment))
            bar.step(f'{name}: fit')
            found[name] = identify_joint(machine, name, records, believed, gains, band=band, modes=modes)
    show(console, f'{machine.name}, seed {seed}, {environment}', found)
    write_figures(json_file, {
        'machine': machine.name, 'seed': seed, 'environment': environment, 'band_Hz': band,
        'ticks': sum(len(experiment.trajectory) for of_axis in plans.values() for experiment in of_axis),
        'axes': as_figures(found),
    })  # fmt: skip
    if out:
        origin = f'pkm identify --machine {machine_name} --seed {seed} --environment {environment}'
        write_model(out / 'model.yaml', machine, found, believed, origin)
        draw_identification(out, machine, found)
        console.plain(f'model.yaml and figures are in {out}')
