"""`pkm calibrate`: lengths and marks of one built machine from laser measurements."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pkm_core.machines import load_machine
from pkm_core.verbs.options import JsonOption, MachineOption, OutOption, SeedOption, folder, progress, write_json


def calibrate(
    machine: MachineOption = 'four_dof',
    measurements: Annotated[
        Path | None, typer.Option(help='CSV of laser measurements; without it a machine is simulated.')
    ] = None,
    poses: Annotated[int, typer.Option(min=8, help='Poses to measure, in a simulation.')] = 60,
    tolerances: Annotated[str, typer.Option(help='Tolerances of config/design, or a YAML file.')] = 'tolerances',
    laser: Annotated[str, typer.Option(help='Laser of config/design, or a YAML file.')] = 'laser',
    seed: SeedOption = 1,
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Estimate link lengths, offsets and encoder marks of one machine, tell how well they are known, judge on other poses.

    Every fourth pose is held out of the estimate. --out gets the calibrated machine file, which every command and node
    takes as --machine, a picture, and the measurements of a simulation, whose format your own must have.

    Example: `pkm calibrate --out runs/calibration`

    Example: `pkm calibrate --measurements laser.csv --out runs/calibration`
    """
    from pkm_core.design.calibration_study import simulate_machine, study_calibration
    from pkm_core.design.measurement import load_laser, read_measurements
    from pkm_core.design.tolerances import load_tolerances
    from pkm_core.design.units import units

    console, model, out = Console(), load_machine(machine).drawing, folder(out)
    spreads, beam = load_tolerances(tolerances), load_laser(laser)
    with progress(console, 3) as step:
        step('measurements')
        if measurements is None:
            simulated, source = simulate_machine(model, spreads, beam, poses, seed), f'a simulation with seed {seed}'
            seen = simulated.measurements
        else:
            simulated, source, seen = None, str(measurements), read_measurements(measurements, model)
        step('estimate')
        study = study_calibration(model, seen, spreads, beam)
        rows = _errors(model, study, simulated)
        if out:
            step('files')
            rows |= _write(out, machine, model, study, simulated, source)
    scale = [factor for factor, _ in units(model)]
    rows = {name: row * scale for name, row in rows.items()}
    write_json(json_file, _figures(model, study, simulated, source, rows))
    found = study.calibration
    console.print(_parameters_table(found, simulated))
    for value, parts in found.identifiability.hardly_known():
        mix = ' '.join(f'{part:+.2f} {name}' for name, part in parts.items())
        console.print(f'hardly known, singular value {value:.2g}: {mix} (in tolerances)')
    console.print(_errors_table(model, rows, len(study.held.q)))
    console.print(f'{len(study.used.q)} poses used, residuals {found.misfit:.2f} of the noise')
    if found.misfit > 1.5:
        console.print('The residuals are larger than the noise: the machine has errors that this model lacks.')
    if out:
        console.print(f'the calibrated machine is {_file(out, model)}, the figure is beside it', soft_wrap=True)


def _rms(errors):
    import numpy as np

    return np.sqrt(np.mean(errors**2, axis=0))


def _errors(model, study, simulated):
    """Return {what: error (m,)} in the order of the table [m, rad]."""
    rows = {
        'laser and encoder noise': study.noise,
        'drawing': _rms(study.before),
        'calibrated': _rms(study.after),
        'drawing, largest': abs(study.before).max(axis=0),
        'calibrated, largest': abs(study.after).max(axis=0),
    }
    if simulated:
        calibrated = study.calibration.machine
        rows['sent to 500 other poses, drawing'] = _rms(simulated.sent(model, model.inverse))
        rows['sent to 500 other poses, calibrated'] = _rms(simulated.sent(model, calibrated.inverse))
    return rows


def _file(out, model):
    return out / 'calibrated' / f'{model.name}.yaml'


def _write(out, machine, model, study, simulated, source):
    """Write every file and return {what: error (m,)} of the machine file as it is loaded again [m, rad]."""
    from pkm_core.design.calibration import prediction_errors
    from pkm_core.design.calibration_figures import draw_calibration
    from pkm_core.design.calibration_file import write_calibrated_machine
    from pkm_core.design.measurement import write_measurements

    path = _file(out, model)
    folder(path.parent)
    write_calibrated_machine(path, machine, study.calibration, source)
    draw_calibration(out, study, simulated.errors if simulated else None)
    if simulated:
        write_measurements(out / 'measurements.csv', model, simulated.measurements)
    return {'calibrated machine file': _rms(prediction_errors(load_machine(path).forward, study.held))}


def _figures(model, study, simulated, source, rows):
    from pkm_core.design.units import units

    names = [f'{name}_{unit}' for name, (_, unit) in zip(model.coordinates, units(model), strict=True)]
    found = study.calibration
    return {
        'machine': model.name,
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
    table = Table(title='deviation from the drawing \\[um]', title_justify='left')
    for i, heading in enumerate(('', 'estimate', '+-', 'tolerance', *(['true'] if simulated else []))):
        table.add_column(heading, justify='right' if i else 'left')
    for name, prior in found.priors.items():
        values = [found.errors[name], found.deviations[name], prior]
        if simulated:
            values.append(simulated.errors[name])
        table.add_row(name, *(f'{1e6 * value:.2f}' for value in values))
    return table


def _errors_table(model, rows, held):
    from pkm_core.design.units import units

    table = Table(title=f'end-point error at {held} poses not used, root mean square', title_justify='left')
    table.add_column('')
    for name, (_, unit) in zip(model.coordinates, units(model), strict=True):
        table.add_column(f'{name} \\[{unit}]', justify='right')
    for title, row in rows.items():
        table.add_row(title, *(f'{value:.3f}' for value in row))
    return table
