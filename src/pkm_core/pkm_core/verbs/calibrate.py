"""`pkm calibrate`: link lengths, offsets and encoder marks of one built machine from laser measurements."""

from pathlib import Path
from typing import Annotated

import typer

from pkm_core.files import writable_folder
from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.options import (
    JsonOption,
    MachineOption,
    OutOption,
    SeedOption,
    TolerancesOption,
    out_folder,
    write_figures,
)


def calibrate(
    machine_name: MachineOption = 'four_dof',
    measurements: Annotated[
        Path | None, typer.Option(help='CSV file of laser measurements; default: a machine is simulated.')
    ] = None,
    poses: Annotated[int, typer.Option(min=8, help='Number of poses of the simulated measurement.')] = 60,
    tolerances: TolerancesOption = 'tolerances',
    laser: Annotated[str, typer.Option(help='Laser of config/design, or a YAML file.')] = 'laser',
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Estimate link lengths, offsets and encoder marks of one machine, with deviations; validate them at other poses.

    Every fourth pose is kept for validation. Writes into --out: the calibrated machine file, which every verb and node
    accepts as its machine; a figure; the measurements of a simulation, which show the format of --measurements.

    Example: `pkm calibrate --out runs/calibration`

    Example: `pkm calibrate --measurements laser.csv --out runs/calibration`
    """
    from pkm_core.design.calibration_study import simulate_machine, study_calibration
    from pkm_core.design.measurement import load_laser, read_measurements
    from pkm_core.design.tolerances import load_tolerances
    from pkm_core.design.units import units

    console, machine, out = Output(), load_machine(machine_name).drawing, out_folder(out)
    spreads, beam = load_tolerances(tolerances), load_laser(laser)
    with progress_bar(console, 3) as bar:
        bar.step('measurements')
        if measurements is None:
            simulated, source = simulate_machine(machine, spreads, beam, poses, seed), f'a simulation with seed {seed}'
            seen = simulated.measurements
        else:
            simulated, source, seen = None, str(measurements), read_measurements(measurements, machine)
        bar.step('estimate')
        study = study_calibration(machine, seen, spreads, beam)
        rows = _errors(machine, study, simulated)
        if out:
            bar.step('files')
            rows |= _write(out, machine_name, machine, study, simulated, source)
    scale = [factor for factor, _ in units(machine)]
    rows = {name: row * scale for name, row in rows.items()}
    write_figures(json_file, _figures(machine, study, simulated, source, rows))
    found = study.calibration
    console.print(_parameters_table(found, simulated))
    for value, parts in found.identifiability.hardly_known():
        mix = ' '.join(f'{part:+.2f} {name}' for name, part in parts.items())
        console.print(f'hardly known, singular value {value:.2g}: {mix} (in tolerances)')
    console.print(_errors_table(machine, rows, len(study.held.q)))
    console.print(f'{len(study.used.q)} poses used, residuals {found.misfit:.2f} of the noise')
    if found.misfit > 1.5:
        console.print('The residuals exceed the noise: the machine has errors outside this model.')
    if out:
        console.plain(f'the calibrated machine is {_file(out, machine)}; the figure is in {out}')


def _rms(errors):
    import numpy as np

    return np.sqrt(np.mean(errors**2, axis=0))


def _errors(machine, study, simulated):
    """Return {what: error (m,)} [m, rad], one entry per row of the table."""
    rows = {
        'laser and encoder noise': study.noise,
        'drawing': _rms(study.before),
        'calibrated': _rms(study.after),
        'drawing, largest': abs(study.before).max(axis=0),
        'calibrated, largest': abs(study.after).max(axis=0),
    }
    if simulated:
        calibrated = study.calibration.machine
        rows['sent to 500 other poses, drawing'] = _rms(simulated.sent(machine, machine.inverse))
        rows['sent to 500 other poses, calibrated'] = _rms(simulated.sent(machine, calibrated.inverse))
    return rows


def _file(out, machine):
    return out / 'calibrated' / f'{machine.name}.yaml'


def _write(out, machine_name, machine, study, simulated, source):
    """Write every file and return {what: error (m,)} [m, rad] of the written machine file, loaded again."""
    from pkm_core.design.calibration import prediction_errors
    from pkm_core.design.calibration_figures import draw_calibration
    from pkm_core.design.calibration_file import write_calibrated_machine
    from pkm_core.design.measurement import write_measurements

    path = _file(out, machine)
    writable_folder(path.parent)
    write_calibrated_machine(path, machine_name, study.calibration, source)
    draw_calibration(out, study, simulated.errors if simulated else None)
    if simulated:
        write_measurements(out / 'measurements.csv', machine, simulated.measurements)
    return {'calibrated machine file': _rms(prediction_errors(load_machine(path).read_by_laser, study.held))}


def _figures(machine, study, simulated, source, rows):
    from pkm_core.design.units import units

    names = [f'{name}_{unit}' for name, (_, unit) in zip(machine.coordinates, units(machine), strict=True)]
    found = study.calibration
    return {
        'machine': machine.name,
        'source': source,
        'poses_used': len(study.used.q),
        'poses_held_out': len(study.held.q),
        'misfit': found.misfit,
        'errors': {title: dict(zip(names, row, strict=True)) for title, row in rows.items()},
        'parameters_um': {
            name: {
                'estimate': 1e6 * found.errors[name],
                'deviation': 1e6 * found.deviations[name],
                'tolerance': 1e6 * found.priors[name],
                'true': 1e6 * simulated.errors[name] if simulated else None,
            }
            for name in found.priors
        },
        'singular_values': found.identifiability.singular_values,
        'hardly_known': found.identifiability.hardly_known(),
    }


def _parameters_table(found, simulated):
    columns = {'estimate': found.errors, '+-': found.deviations, 'tolerance': found.priors}
    if simulated:
        columns['true'] = simulated.errors
    rows = [(name, *(f'{1e6 * column[name]:.2f}' for column in columns.values())) for name in found.priors]
    return table('deviation from the drawing [um]', ['', *columns], rows)


def _errors_table(machine, rows, held):
    from pkm_core.design.units import units

    headings = [f'{name} [{unit}]' for name, (_, unit) in zip(machine.coordinates, units(machine), strict=True)]
    cells = [(title, *(f'{value:.3f}' for value in row)) for title, row in rows.items()]
    return table(f'end-point error at {held} poses not used, root mean square', ['', *headings], cells)
