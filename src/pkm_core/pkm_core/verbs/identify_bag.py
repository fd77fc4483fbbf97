"""`pkm identify-bag`: the fits of `pkm identify` on bags, of this cell or of a foreign axis."""

from pathlib import Path
from typing import Annotated

import typer

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output
from pkm_core.verbs.options import (
    ControllerOption,
    JointsOption,
    JsonOption,
    MachineOption,
    ModesOption,
    NamespaceOption,
    OutOption,
    OverwriteOption,
    finite,
    out_folder,
    positive,
    robust_gains,
    write_figures,
)


def identify_bag(
    bags: Annotated[list[Path], typer.Argument(help='Bags of this cell, or bags that have the topics of the options.')],
    machine_name: MachineOption = 'four_dof',
    joint: JointsOption = None,
    namespace: NamespaceOption = '/pkm',
    controller: ControllerOption = 'robust',
    modes: ModesOption = None,
    band: Annotated[
        tuple[float, float] | None,
        typer.Option(callback=finite, help='Band in which H is fitted [Hz]; default: that of the excitation.'),
    ] = None,
    input_topic: Annotated[
        str, typer.Option(help='Topic of the drive of a foreign axis; empty: an axis of this cell.')
    ] = '',
    input_field: Annotated[str, typer.Option(help="Field of the drive, e.g. 'effort[2]' or 'effort[elbow]'.")] = 'data',
    input_unit: Annotated[str, typer.Option(help='Unit of the drive.')] = 'V',
    output_topic: Annotated[str, typer.Option(help='Topic of the measured position.')] = '',
    output_field: Annotated[str, typer.Option(help='Field of the measured position.')] = 'data',
    output_unit: Annotated[
        str, typer.Option(help="Unit of the measured position; '0.2 um' for counts of that size.")
    ] = 'm',
    reference_topic: Annotated[
        str, typer.Option(help='Topic of the reference position, if recorded; in the unit of the measured position.')
    ] = '',
    reference_field: Annotated[str, typer.Option(help='Field of the reference position.')] = 'data',
    excitation_topic: Annotated[
        str, typer.Option(help='Topic of the excitation added to the drive, in the unit of the drive.')
    ] = '',
    excitation_field: Annotated[str, typer.Option(help='Field of the excitation.')] = 'data',
    delay: Annotated[
        float, typer.Option(min=0.0, callback=finite, help='Time from the stamp of the drive to its effect [ms].')
    ] = 0.0,
    limit: Annotated[
        float | None,
        typer.Option(callback=positive, help='Saturation of the drive, in its unit; default: none is known.'),
    ] = None,
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Identify axes from bags: plain moves give K and a, bags with an excitation give the resonances.

    Without --input-topic the bags are of this cell; ordinary learning cycles are enough for K and a. With --input-topic
    they are of one foreign axis, in any bag that rosbags reads. Writes figures into --out, and model.yaml of this cell.

    Example: `pkm identify-bag runs/first/four_dof_70ms_0001* --out runs/identified`

    Example: `pkm identify-bag arm --input-topic /joint_states --input-field 'effort[elbow]' --input-unit 'N m'
    --output-topic /joint_states --output-field 'position[elbow]' --output-unit rad`
    """
    from pkm_core.bag.signals import Signal
    from pkm_core.identification.figures import draw_identification
    from pkm_core.identification.summary import as_figures, show

    console, out = Output(), out_folder(out)
    machine = None if input_topic else load_machine(machine_name)
    if machine is None:
        if not output_topic:
            raise PkmError('--output-topic: is missing; --input-topic names a foreign axis, which needs both')
        signals = {
            'drive': Signal(input_topic, input_field, input_unit),
            'sensor': Signal(output_topic, output_field, output_unit),
            'reference': Signal(reference_topic, reference_field, output_unit) if reference_topic else None,
            'excitation': Signal(excitation_topic, excitation_field, input_unit) if excitation_topic else None,
        }
        found, notes = _foreign_axis(bags, signals, 1e-3 * delay, limit or float('inf'), band, modes or 2)
        title = f'{output_topic} {output_field} over {input_topic} {input_field}'
        units = {'gain_unit': 'SI'}
    else:
        found, notes, believed = _cell(machine, bags, joint, namespace, controller, band, modes)
        title, units = f'{machine.name}, {len(bags)} bags', {}
    show(console, title, found, notes, **units)
    write_figures(json_file, {'bags': [str(bag) for bag in bags], 'notes': notes, 'axes': as_figures(found)})
    if out:
        if machine is not None:
            from pkm_core.identification.model_file import write_model

            write_model(out / 'model.yaml', machine, found, believed, 'pkm identify-bag ' + ' '.join(map(str, bags)))
        draw_identification(out, machine, found)
        console.plain(f'results are in {out}')


def _cell(machine, bags, joints, namespace, controller, band, modes):
    """Return the identified axes of a machine of this cell, warnings about the bags, and the models of config."""
    from pkm_core.control.model import load_model
    from pkm_core.identification.bag_data import read_cell_bag
    from pkm_core.identification.identify import identify_joint

    believed, gains = load_model(machine), robust_gains(machine, controller)
    records, notes = [], []
    for bag in bags:
        record, warnings = read_cell_bag(machine, bag, namespace)
        records.append(record)
        notes += warnings
    found = {}
    for joint in joints or machine.joints:
        if joints or any(record.moves_plainly(machine, joint) for record in records):
            found[joint] = identify_joint(machine, joint, records, believed, gains, band=band, modes=modes)
    if not found:
        raise PkmError(f'{machine.name}: no axis moves without excitation in these bags; K and a need plain moves')
    return found, notes, believed


def _foreign_axis(bags, signals, delay, limit, band, modes):
    """Return the identified foreign axis, under the name 'axis', and warnings about the bags."""
    from pkm_core.identification.bag_data import read_axis
    from pkm_core.identification.frequency_response import estimate_response
    from pkm_core.identification.identify import identify_axis

    moves, responses, notes = [], [], []
    for bag in bags:
        data, dead_time, warnings = read_axis(bag, **signals, delay=delay, limit=limit)
        notes += warnings
        excited = data.excitation is not None and data.excitation.any()
        if excited or (band and data.excitation is None):
            responses.append(estimate_response(data, band))
        if not excited:
            moves.append(data)
    uncertain = 0.25 * data.sample_time  # the deviation of the given delay is unknown
    axis = identify_axis('axis', moves, responses, delay=dead_time, delay_deviation=uncertain, modes=modes)
    return {'axis': axis}, notes
