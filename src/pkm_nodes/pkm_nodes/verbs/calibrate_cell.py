"""`pkm calibrate-cell`: calibration of a machine by laser in the ROS 2 graph."""

from pathlib import Path
from typing import Annotated

import typer

from pkm_core.arrangement import Arrangement
from pkm_core.design.cell_calibration import POSES, VERIFICATION, Request, plan_cycles
from pkm_core.design.units import units
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.real_geometry import printed_unit
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.options import (
    CellArrangementOption,
    EnvironmentOption,
    JsonOption,
    MachineOption,
    OverwriteOption,
    RunFolderOption,
    SeedOption,
    run_folder,
    write_figures,
)
from pkm_nodes.runtime.discovery import discover_on_this_computer


def calibrate_cell(
    machine_name: MachineOption = 'four_dof',
    poses: Annotated[int, typer.Option(min=1, help='Number of poses of the fit.')] = POSES,
    verification: Annotated[int, typer.Option(min=1, help='Number of other poses that verify it.')] = VERIFICATION,
    wait: Annotated[float, typer.Option(help='Rest at a pose before the average begins [ms].')] = 0.0,
    averaging: Annotated[float, typer.Option(help='Average of laser and encoders at rest [ms].')] = 0.0,
    plan_seed: Annotated[int, typer.Option(min=0, help='Seed of the plan of the poses.')] = 1,
    seed: SeedOption = 1,
    environment: EnvironmentOption = 'nominal',
    arrangement: CellArrangementOption = Arrangement.composed,
    out: RunFolderOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Calibrate the machine of a cell in the ROS 2 graph: lengths, offsets and encoder marks by laser.

    Starts the cell and sends one goal of the action calibrate. Writes the machine file, the measurements and a figure
    into OUT/calibrated, bags into OUT/bags. Use the file with `pkm run --machine OUT/calibrated/planar.yaml`.

    Example: `pkm calibrate-cell --machine planar --poses 20 --out runs/calibrated`
    """
    console, machine = Output(), load_machine(machine_name)
    request = Request(poses, verification, 1e-3 * wait, 1e-3 * averaging, plan_seed)
    plan_cycles(machine, request)  # refuses it before a process starts
    out = run_folder(out, f'{machine.name}_calibrated')
    try:
        result = _calibrate(console, machine_name, request, seed, environment, arrangement, out)
    except PkmError as error:
        raise PkmError(f'{error}\nlogs and bags of the cell are in {out}') from None
    given = {'machine': machine.name, 'seed': seed, 'environment': environment, 'arrangement': arrangement}
    console.print(_errors_table(machine, result, f'{machine.name}, seed {seed}, {environment}, {arrangement}'))
    console.print(_parameters_table(result))
    console.print(f'{request.poses} poses used, misfit {result.misfit:.2f} of the noise; allowed up to 1.5')
    console.plain(f'least known: {result.weakest} (in tolerances)')
    write_figures(json_file, given | _figures(request, result))
    if result.message:
        raise PkmError(f'{result.message}\nthe calibration is in {Path(result.file).parent}; do not use it')
    console.plain(f'the calibrated machine is {result.file}; measurements and figure are beside it, bags in {out}')
    console.plain(f'use it with: pkm run --machine {result.file} --seed {seed} --environment {environment}')


def _calibrate(console, machine_name, request, seed, environment, arrangement, out):
    """Run the cell and return the `Calibrate.Result`."""
    discover_on_this_computer()
    from pkm_interfaces.action import Calibrate
    from pkm_nodes.clients.calibrate_client import CalibrateClient
    from pkm_nodes.clients.cell_processes import CellProcesses

    names = {Calibrate.Feedback.FITTING: 'fitting', Calibrate.Feedback.LOADING: 'taking up the calibrated file'}
    with (
        progress_bar(console, name='starting the cell') as bar,
        CellProcesses(machine_name, arrangement, seed=seed, environment=environment, folder=out) as cell,
        CalibrateClient(session=cell.session) as client,
    ):
        client.wait_until_up(cell.check)

        def on_feedback(feedback):
            visit = f'pose {feedback.pose} of {feedback.poses}'
            bar.show(feedback.progress, names.get(feedback.phase, visit))

        return client.calibrate(request, '.', cell.check, on_feedback)


def _rows(result):
    """Return {what: error (m,)} [m, rad], one entry per row of the table."""
    return {
        'noise of an average': result.noise,
        'before, rms': result.before,
        'calibrated, rms': result.after,
        'before, largest': result.before_largest,
        'calibrated, largest': result.after_largest,
    }


def _errors_table(machine, result, title):
    scale = units(machine)
    headings = [f'{name}\n[{unit}]' for name, (_, unit) in zip(machine.coordinates, scale, strict=True)]
    rows = [
        (title, *(f'{factor * value:.3f}' for value, (factor, _) in zip(values, scale, strict=True)))
        for title, values in _rows(result).items()
    ]
    return table(f'{title}: laser minus commanded pose at poses not used', ['', *headings], rows)


def _parameters_table(result):
    columns = zip(result.parameters, result.estimates, result.deviations, strict=True)
    rows = []
    for name, estimate, deviation in columns:
        factor, unit = printed_unit(name)
        label = name if unit == 'um' else f'{name} [{unit}]'
        rows.append((label, f'{factor * estimate:.2f}', f'{factor * deviation:.2f}'))
    return table('deviation from the drawing [um]', ['', 'estimate', '+-'], rows)


def _figures(request, result):
    names = list(result.coordinates)
    return {
        'poses': request.poses,
        'verification': request.verification,
        'accepted': not result.message,
        'message': result.message,
        'misfit': result.misfit,
        'weakest': result.weakest,
        'errors': {title: dict(zip(names, values, strict=True)) for title, values in _rows(result).items()},
        'parameters': {
            name: {'estimate': estimate, 'deviation': deviation}
            for name, estimate, deviation in zip(result.parameters, result.estimates, result.deviations, strict=True)
        },
        'file': result.file,
        'geometry': result.geometry,
        'bags': list(result.bags),
    }
