"""`pkm identify-cell`: what `pkm identify` does, on the real ROS 2 graph."""

import os
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from pkm_core.bag.reader import writable_folder
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.identification.plan import KINDS, POSITIONS, Request, plan
from pkm_core.machines import load_machine
from pkm_core.verbs.identify import (
    BAND,
    JOG,
    VOLTAGE,
    BandOption,
    JogOption,
    JointsOption,
    PositionsOption,
    StrokeOption,
    VoltageOption,
)
from pkm_core.verbs.options import JsonOption, MachineOption, SeedOption, write_json
from pkm_nodes.verbs.run import Arrangement


def identify_cell(
    machine: MachineOption = 'four_dof',
    joint: JointsOption = None,
    kind: Annotated[str, typer.Option(help=f'Which experiments: {", ".join(KINDS)}.')] = 'both',
    positions: PositionsOption = POSITIONS,
    band: BandOption = BAND,
    voltage: VoltageOption = VOLTAGE,
    jog: JogOption = JOG,
    stroke: StrokeOption = 0.0,
    seed: SeedOption = 1,
    environment: Annotated[str, typer.Option(help='How rough the world is: a section of config/truth.')] = 'nominal',
    arrangement: Annotated[Arrangement, typer.Option(help='One process, or one a node.')] = Arrangement.composed,
    out: Annotated[Path | None, typer.Option(help='Folder for results; a new one in runs/ by default.')] = None,
    json_file: JsonOption = None,
):
    """
    Identify P = K/(s (s + a)) H(s) of the axes of a cell: real nodes, one bag an experiment.

    Starts the cell and sends one goal of the action identify. The bags hold the bits that `pkm identify` sees without
    ROS. Writes the model file, identification.json and pictures into OUT/identified, bags into OUT/bags.

    Example: `pkm identify-cell --machine planar --joint d1 --out runs/identified`
    """
    console, system = Console(), load_machine(machine)
    request = Request(tuple(joint or ()), kind, positions, band, voltage, 1e-3 * jog, 1e-3 * stroke)
    # what the node would refuse starts no process
    plan(system, request, load_model(system), load_control(system))
    out = writable_folder(out or Path('runs') / f'{datetime.now():%Y%m%dT%H%M%S}_{system.name}_identified')
    try:
        result = _identify(console, machine, request, seed, environment, arrangement.value, out)
    except PkmError as error:
        raise PkmError(f'{error}\nwhat the cell printed and recorded is in {out}') from None
    console.print(fits_table(f'{system.name}, seed {seed}, {environment}, {arrangement.value}', result.fits))
    print_warnings(console, result.warnings)
    figures = {fit.joint: fit_figures(fit) for fit in result.fits}
    given = {'machine': system.name, 'seed': seed, 'environment': environment, 'arrangement': arrangement.value}
    files = {'model_file': result.model_file, 'bags': result.bags, 'warnings': result.warnings}
    write_json(json_file, given | files | {'axes': figures})
    console.print(f'{result.model_file or "results"} and bags are in {out}', soft_wrap=True)


def _identify(console, machine, request, seed, environment, arrangement, out):
    """Run the cell and return the `Identify.Result`."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    from pkm_nodes.clients.cell_processes import CellProcesses
    from pkm_nodes.clients.identify_client import IdentifyClient

    columns = (TextColumn('{task.description}'), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with (
        Progress(*columns, console=console, transient=True) as progress,
        CellProcesses(machine, arrangement, seed=seed, environment=environment, folder=out) as cell,
        IdentifyClient() as client,
    ):
        task = progress.add_task('starting the cell', total=1.0)
        client.wait_until_up(cell.check)

        def on_feedback(feedback):
            progress.update(task, completed=feedback.progress, description=feedback.experiment or 'fitting')

        return client.identify(goal_of(request), cell.check, on_feedback)


def goal_of(request):
    """Return a `Request` as a goal of the action."""
    from pkm_interfaces.action import Identify
    from pkm_nodes.messages.conversions import experiments_to_msg

    return Identify.Goal(
        joints=list(request.joints),
        kind=experiments_to_msg(request.kind),
        positions=request.positions,
        band=list(request.band),
        voltage=request.voltage,
        jog_speed=request.jog_speed,
        stroke=request.stroke,
    )


def fits_table(title, fits):
    """Return the table of `AxisFit` messages; +- is one standard deviation."""
    table = Table(title=escape(title), title_justify='left', box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    headings = ('axis', 'K\n\\[m/s²/V]', 'a\n\\[1/s]', 'resonances\n\\[Hz]', 'left out:\nL \\[%]', '\nH \\[%]')
    for heading in headings:
        table.add_column(heading, justify='left' if heading == 'axis' else 'right', no_wrap=True)
    for fit in fits:
        figures = fit_figures(fit)
        table.add_row(
            fit.joint,
            f'{fit.gain:.4g} ± {figures["gain_deviation"]:.2g}',
            f'{fit.viscosity:.4g} ± {figures["viscosity_deviation"]:.2g}',
            ', '.join(f'{value:.1f}' for value in fit.resonance),
            f'{fit.fit_percent:.2f}',
            f'{fit.response_fit_percent:.1f}',
        )
    return table


def print_warnings(console, warnings):
    """Print what an identification warns of."""
    for text in warnings:
        console.print(f'[yellow]warning:[/yellow] {escape(text)}', soft_wrap=True, highlight=False)


def fit_figures(fit):
    """Return the figures of an `AxisFit` message, its responses left out."""
    names = ('resonance', 'resonance_damping', 'antiresonance', 'antiresonance_damping')
    return {
        'gain': fit.gain,
        'gain_deviation': float(fit.covariance[0]) ** 0.5,
        'viscosity': fit.viscosity,
        'viscosity_deviation': float(fit.covariance[3]) ** 0.5,
        'fit_percent_left_out': fit.fit_percent,
        'response_fit_percent_left_out': fit.response_fit_percent,
        'modes': list(zip(*(getattr(fit, name) for name in names), strict=True)),
    }
