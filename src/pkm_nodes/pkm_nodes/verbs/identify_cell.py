"""`pkm identify-cell`: the identification of `pkm identify` in the ROS 2 graph."""

from typing import Annotated

import typer

from pkm_core.arrangement import Arrangement
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.identification.plan import KINDS, POSITIONS, Request, plan
from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.identify import (
    BAND,
    JOG,
    VOLTAGE,
    BandOption,
    JogOption,
    PositionsOption,
    StrokeOption,
    VoltageOption,
)
from pkm_core.verbs.options import (
    CellArrangementOption,
    EnvironmentOption,
    JointsOption,
    JsonOption,
    MachineOption,
    OverwriteOption,
    RunFolderOption,
    SeedOption,
    run_folder,
    write_figures,
)
from pkm_nodes.runtime.discovery import discover_on_this_computer


def identify_cell(
    machine_name: MachineOption = 'four_dof',
    joint: JointsOption = None,
    kind: Annotated[str, typer.Option(help=f'Experiments to run: {", ".join(KINDS)}.')] = 'both',
    positions: PositionsOption = POSITIONS,
    band: BandOption = BAND,
    voltage: VoltageOption = VOLTAGE,
    jog: JogOption = JOG,
    stroke: StrokeOption = 0.0,
    seed: SeedOption = 1,
    environment: EnvironmentOption = 'nominal',
    arrangement: CellArrangementOption = Arrangement.composed,
    out: RunFolderOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Identify P = K/(s (s + a)) H(s) of the axes of a cell in the ROS 2 graph; one bag per experiment.

    Starts the cell and sends one goal of the action identify. The bags hold the same bits as the records of
    `pkm identify`. Writes the model file, identification.json and figures into OUT/identified, bags into OUT/bags.

    Example: `pkm identify-cell --machine planar --joint d1 --out runs/identified`
    """
    discover_on_this_computer()
    console, machine = Output(), load_machine(machine_name)
    request = Request(tuple(joint or ()), kind, positions, band, voltage, 1e-3 * jog, 1e-3 * stroke)
    plan(machine, request, load_model(machine), load_control(machine))  # refuses it before a process starts
    out = run_folder(out, f'{machine.name}_identified')
    try:
        result = _identify(console, machine_name, request, seed, environment, arrangement, out)
    except PkmError as error:
        raise PkmError(f'{error}\nlogs and bags of the cell are in {out}') from None
    console.print(_fits_table(f'{machine.name}, seed {seed}, {environment}, {arrangement}', result.fits))
    console.warnings(result.warnings)
    figures = {fit.joint: _fit_figures(fit) for fit in result.fits}
    given = {'machine': machine.name, 'seed': seed, 'environment': environment, 'arrangement': arrangement}
    files = {'model_file': result.model_file, 'bags': result.bags, 'warnings': result.warnings}
    write_figures(json_file, given | files | {'axes': figures})
    console.plain(f'{result.model_file or "results"} and bags are in {out}')


def _identify(console, machine_name, request, seed, environment, arrangement, out):
    """Run the cell and return the `Identify.Result`."""
    from pkm_nodes.clients.cell_processes import CellProcesses
    from pkm_nodes.clients.identify_client import IdentifyClient

    with (
        progress_bar(console, name='starting the cell') as bar,
        CellProcesses(machine_name, arrangement, seed=seed, environment=environment, folder=out) as cell,
        IdentifyClient(session=cell.session) as client,
    ):
        client.wait_until_up(cell.check)

        def on_feedback(feedback):
            bar.show(feedback.progress, feedback.experiment or 'fitting')

        return client.identify(request, cell.check, on_feedback)


def _fits_table(title, fits):
    """Return the table of `AxisFit` messages; +- is one standard deviation."""
    headings = ('axis', 'K\n[m/s²/V]', 'a\n[1/s]', 'resonances\n[Hz]', 'left out:\nL [%]', '\nH [%]')
    rows = []
    for fit in fits:
        figures = _fit_figures(fit)
        rows.append(
            (
                fit.joint,
                f'{fit.gain:.4g} ± {figures["gain_deviation"]:.2g}',
                f'{fit.viscosity:.4g} ± {figures["viscosity_deviation"]:.2g}',
                ', '.join(f'{value:.1f}' for value in fit.resonance),
                f'{fit.fit_percent:.2f}',
                f'{fit.response_fit_percent:.1f}',
            )
        )
    return table(title, headings, rows, wide=False, no_wrap=True)


def _fit_figures(fit):
    """Return the figures of an `AxisFit` message without its frequency responses."""
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
