"""`pkm calibrate`: link lengths, offsets and encoder marks of one built machine from laser measurements."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pkm_core.errors import PkmError
from pkm_core.files import writable_folder
from pkm_core.machines import load_machine
from pkm_core.machines.checks import ANGLES
from pkm_core.machines.real_geometry import printed_unit
from pkm_core.verbs.completion import names_of
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.options import (
    EnvironmentOption,
    JsonOption,
    MachineOption,
    NamespaceOption,
    OutOption,
    OverwriteOption,
    SeedOption,
    TolerancesOption,
    out_folder,
    write_figures,
)


class Geometry(StrEnum):
    """Set of unknowns."""

    auto = 'auto'
    lengths = 'lengths'
    full = 'full'


OTHERS = 500  # poses without a measurement at which a simulated machine is judged


def calibrate(
    machine_name: MachineOption = 'four_dof',
    measurements: Annotated[
        Path | None, typer.Option(help='CSV file of laser measurements; default: a machine is simulated.')
    ] = None,
    bag: Annotated[
        list[Path] | None,
        typer.Option(
            help='Bag of a cycle of the cell that rests at poses, with the laser; repeatable for one machine.'
        ),
    ] = None,
    namespace: NamespaceOption = '/pkm',
    encoder_topic: Annotated[
        list[str] | None,
        typer.Option(help='Topic of the encoders in bags of another recorder; one for all, or one per joint.'),
    ] = None,
    encoder_field: Annotated[
        list[str] | None, typer.Option(help="Field of each joint, in order, e.g. 'position[0]'; repeatable.")
    ] = None,
    encoder_unit: Annotated[str, typer.Option(help="Unit of the encoders; '0.2 um' for counts of that size.")] = 'm',
    laser_topic: Annotated[
        list[str] | None, typer.Option(help='Topic of the laser; one for all, or one per coordinate.')
    ] = None,
    laser_field: Annotated[
        list[str] | None, typer.Option(help="Field of each coordinate, in order, e.g. 'vector.x'; repeatable.")
    ] = None,
    laser_unit: Annotated[str, typer.Option(help='Unit of the displacements.')] = 'm',
    laser_angle_unit: Annotated[str, typer.Option(help='Unit of the rotation.')] = 'rad',
    rest: Annotated[float, typer.Option(min=0.0, help='Least rest in bags of another recorder [ms].')] = 130.0,
    average: Annotated[float, typer.Option(min=1.0, help='Average at the end of a rest [ms].')] = 100.0,
    poses: Annotated[int, typer.Option(min=16, help='Number of poses of the simulated measurement.')] = 60,
    tolerances: TolerancesOption = 'tolerances',
    laser: Annotated[
        str, typer.Option(autocompletion=names_of('design'), help='Laser of config/design, or a YAML file.')
    ] = 'laser',
    seed: SeedOption = 1,
    environment: EnvironmentOption = 'nominal',
    geometry: Annotated[
        Geometry,
        typer.Option(
            help='Unknowns: lengths, offsets and marks; full: also guides, scales and laser axes; auto: the set under '
            'which the measurements are more probable.'
        ),
    ] = Geometry.auto,
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Estimate link lengths, offsets, marks and geometry of one machine, with deviations; validate them at other poses.

    The simulated machine is the one that a cell with the same --seed and --environment runs. Every fourth pose is kept
    for validation. Writes into --out: the calibrated machine file, which every verb and node accepts as its machine; a
    figure; the measurements, in the format of --measurements. Both files name the measured machine, and no other one
    runs with them.

    Example: `pkm calibrate --seed 1 --out runs/calibration`

    Example: `pkm calibrate --measurements laser.csv --out runs/calibration`

    Example: `pkm calibrate --bag runs/poses/poses_0001* --out runs/calibration`
    """
    from pkm_core.design.calibration_study import study_calibration
    from pkm_core.design.measurement import load_laser, read_measurements
    from pkm_core.design.tolerances import load_tolerances
    from pkm_core.design.units import units
    from pkm_core.experiments.simulated_calibration import TrueSpecimen, measure_study

    console, machine, out = Output(), load_machine(machine_name).drawing, out_folder(out)
    spreads, beam = load_tolerances(tolerances), load_laser(laser)
    with progress_bar(console, 3) as bar:
        bar.step('measurements')
        if measurements is not None and bag:
            raise PkmError('--bag: given with --measurements; expected one of them')
        simulated, source = None, str(measurements)
        if bag:
            topics, fields = (encoder_topic, laser_topic), (encoder_field, laser_field)
            others = topics, fields, (encoder_unit, laser_unit, laser_angle_unit), 1e-3 * rest
            seen = _of_bags(machine, bag, beam, namespace, 1e-3 * average, others)
            source = ', '.join(each.name for each in bag)
        elif measurements is not None:
            seen = read_measurements(measurements, machine)
        else:
            seen = measure_study(machine, poses, spreads, beam, seed, environment)
            simulated, source = TrueSpecimen(machine, seed, environment), f'a simulation with seed {seed}'
        bar.step('estimate')
        study = study_calibration(machine, seen, spreads, beam, geometry.value)
        rows = _errors(machine, study, simulated)
        if out:
            bar.step('files')
            rows |= _write(out, machine_name, machine, study, simulated, source, seen)
    scale = [factor for factor, _ in units(machine)]
    rows = {name: row * scale for name, row in rows.items()}
    found = study.calibration
    console.print(_parameters_table(found, simulated))
    for value, parts in found.identifiability.hardly_known():
        mix = ' '.join(f'{part:+.2f} {name}' for name, part in parts.items())
        console.print(f'hardly known, singular value {value:.2g}: {mix} (in tolerances)')
    console.print(_errors_table(machine, rows, len(study.held.q)))
    console.plain(f'specimen: {found.machine.specimen or "not named"}')
    console.print(f'{len(study.used.q)} poses used, residuals {found.misfit:.2f} of the noise')
    write_figures(json_file, _figures(machine, study, simulated, source, rows))
    if study.verification.worse:
        console.warnings(study.verification.reasons(machine))
    if out:
        console.plain(f'the calibrated machine is {_file(out, machine)}; the figure is in {out}')


def _of_bags(machine, bags, laser, namespace, averaged, others):
    """Return the measurements of bags of this cell or, if `others` has topics, of another recorder."""
    from pkm_core.design.rest_bags import rests_from_bag, rests_from_signals
    from pkm_core.design.rests import joined

    (encoder_topics, laser_topics), (encoder_fields, laser_fields), (length, seen, angle), rest = others
    if not encoder_topics and not laser_topics:
        return joined([rests_from_bag(each, machine, laser, namespace=namespace, averaged=averaged) for each in bags])
    encoders = _signals(
        'encoder', machine.joints, encoder_topics, encoder_fields, dict.fromkeys(machine.joints, length)
    )
    units = {name: angle if name in ANGLES else seen for name in machine.coordinates}
    displacements = _signals('laser', machine.coordinates, laser_topics, laser_fields, units)
    given = {'rest': rest, 'averaged': averaged}
    return joined([rests_from_signals(each, machine, laser, encoders, displacements, **given) for each in bags])


def _signals(what, names, topics, fields, units):
    """Return one `Signal` per name of `names`."""
    from pkm_core.bag.signals import Signal

    topics, fields = topics or [], fields or ['data']
    topics = topics * len(names) if len(topics) == 1 else topics
    fields = fields * len(names) if len(fields) == 1 and len(set(topics)) == len(names) else fields
    for option, came in (('topic', topics), ('field', fields)):
        if len(came) != len(names):
            raise PkmError(f'--{what}-{option}: {len(came)} given; expected one per name of {list(names)}')
    return [Signal(topic, field, units[name]) for name, topic, field in zip(names, topics, fields, strict=True)]


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
        rows[f'sent to {OTHERS} other poses, drawing'] = _rms(simulated.sent(machine.inverse))
        rows[f'sent to {OTHERS} other poses, calibrated'] = _rms(simulated.sent(calibrated.inverse))
    return rows


def _file(out, machine):
    return out / 'calibrated' / f'{machine.name}.yaml'


def _write(out, machine_name, machine, study, simulated, source, seen):
    """Write every file and return {what: error (m,)} [m, rad] of the written machine file, loaded again."""
    from pkm_core.design.calibration import prediction_errors
    from pkm_core.design.calibration_figures import draw_calibration
    from pkm_core.design.calibration_file import write_calibrated_machine
    from pkm_core.design.measurement import write_measurements

    path = _file(out, machine)
    writable_folder(path.parent)
    write_calibrated_machine(path, machine_name, study.calibration, source)
    draw_calibration(out, study, simulated.errors if simulated else None)
    write_measurements(out / 'measurements.csv', machine, seen)
    return {'calibrated machine file': _rms(prediction_errors(load_machine(path).read_by_laser, study.held))}


def _figures(machine, study, simulated, source, rows):
    from pkm_core.design.units import units

    names = [f'{name}_{unit}' for name, (_, unit) in zip(machine.coordinates, units(machine), strict=True)]
    found = study.calibration
    return {
        'machine': machine.name,
        'source': source,
        'specimen': str(found.machine.specimen or 'not named'),
        'poses_used': len(study.used.q),
        'poses_held_out': len(study.held.q),
        'misfit': found.misfit,
        'worse': list(study.verification.worse),
        'errors': {title: dict(zip(names, row, strict=True)) for title, row in rows.items()},
        'parameters_um': {
            name: {
                'estimate': 1e6 * found.errors[name],
                'deviation': 1e6 * found.deviations[name],
                'tolerance': 1e6 * found.priors[name],
                'true': 1e6 * simulated.errors.get(name, 0.0) if simulated else None,
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
    rows = []
    for name in found.priors:
        factor, unit = printed_unit(name)
        cells = (f'{factor * column.get(name, 0.0):.2f}' for column in columns.values())
        rows.append((name if unit == 'um' else f'{name} [{unit}]', *cells))
    return table('deviation from the drawing [um]', ['', *columns], rows)


def _errors_table(machine, rows, held):
    from pkm_core.design.units import units

    headings = [f'{name} [{unit}]' for name, (_, unit) in zip(machine.coordinates, units(machine), strict=True)]
    cells = [(title, *(f'{value:.3f}' for value in row)) for title, row in rows.items()]
    return table(f'end-point error at {held} poses not used, root mean square', ['', *headings], cells)
