"""`pkm identify-bag`: the same fits on bags, of this cell or of somebody else's axis."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.verbs.options import JsonOption, MachineOption, OutOption, folder, write_json


def identify_bag(
    bags: Annotated[list[Path], typer.Argument(help='Bags: of this cell, or any with the topics named.')],
    machine: MachineOption = 'four_dof',
    joint: Annotated[list[str] | None, typer.Option(help='Axis of this cell, repeatable; all by default.')] = None,
    namespace: Annotated[str, typer.Option(help='Of the cell that was recorded.')] = '/pkm',
    control: Annotated[
        str, typer.Option(help="Gains that ran meanwhile: of config/control, or a YAML file; '' is the machine's.")
    ] = '',
    modes: Annotated[
        int | None, typer.Option(min=1, max=5, help="Resonances; of this cell as many as the axis's model has, else 2.")
    ] = None,
    band: Annotated[
        tuple[float, float] | None, typer.Option(help='Where H is fitted [Hz]; where the excitation is by default.')
    ] = None,
    input_topic: Annotated[str, typer.Option(help="Somebody else's axis: what drives it.")] = '',
    input_field: Annotated[str, typer.Option(help="Field of it, e.g. 'effort[2]' or 'effort[elbow]'.")] = 'data',
    input_unit: Annotated[str, typer.Option(help='Its unit.')] = 'V',
    output_topic: Annotated[str, typer.Option(help='Where it is.')] = '',
    output_field: Annotated[str, typer.Option(help='Field of it.')] = 'data',
    output_unit: Annotated[str, typer.Option(help="Its unit; '0.2 um' for counts of that size.")] = 'm',
    reference_topic: Annotated[
        str, typer.Option(help='Where it should be, if recorded; in the unit of the output.')
    ] = '',
    reference_field: Annotated[str, typer.Option(help='Field of it.')] = 'data',
    excitation_topic: Annotated[str, typer.Option(help='What was added to the drive; in its unit.')] = '',
    excitation_field: Annotated[str, typer.Option(help='Field of it.')] = 'data',
    delay: Annotated[float, typer.Option(min=0.0, help='From the stamp of the drive to its effect [ms].')] = 0.0,
    limit: Annotated[float, typer.Option(help='Of the drive, in the unit of the input.')] = float('inf'),
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Identify axes from bags: bags of plain moves give K and a, those with an excitation the resonances.

    Without --input-topic the bags are of this cell; ordinary learning cycles do for K and a. With it they are of one
    axis of anybody's, in any bag rosbags reads. Writes figures, and of this cell model.yaml, into --out.

    Example: `pkm identify-bag runs/first/four_dof_70ms_0001* --out runs/identified`

    Example: `pkm identify-bag arm --input-topic /joint_states --input-field 'effort[elbow]' --input-unit 'N m'
    --output-topic /joint_states --output-field 'position[elbow]' --output-unit rad`
    """
    from pkm_core.identification.bag_data import Signal
    from pkm_core.identification.figures import draw_identification
    from pkm_core.identification.summary import as_figures, show

    console, out = Console(), folder(out)
    system = None if input_topic else load_machine(machine)
    if system is None:
        if not output_topic:
            raise PkmError('--output-topic is missing; --input-topic names an axis that is not of this cell')
        signals = {
            'drive': Signal(input_topic, input_field, input_unit),
            'sensor': Signal(output_topic, output_field, output_unit),
            'reference': Signal(reference_topic, reference_field, output_unit) if reference_topic else None,
            'excitation': Signal(excitation_topic, excitation_field, input_unit) if excitation_topic else None,
        }
        found, notes = _foreign_axis(bags, signals, 1e-3 * delay, limit, band, modes or 2)
        title = f'{output_topic} {output_field} over {input_topic} {input_field}'
        units = {'gain_unit': 'SI'}
    else:
        found, notes, believed = _cell(system, bags, joint, namespace, control, band, modes)
        title, units = f'{system.name}, {len(bags)} bags', {}
    show(console, title, found, notes, **units)
    write_json(json_file, {'bags': [str(bag) for bag in bags], 'notes': notes, 'axes': as_figures(found)})
    if out:
        if system is not None:
            from pkm_core.identification.model_file import write_model

            write_model(out / 'model.yaml', system, found, believed, 'pkm identify-bag ' + ' '.join(map(str, bags)))
        draw_identification(out, system, found)
        console.print(f'results are in {out}', soft_wrap=True)


def _cell(system, bags, joints, namespace, control, band, modes):
    """Return what was identified of a machine of this cell, notes on the bags, and what was believed of it."""
    from pkm_core.control.model import load_model
    from pkm_core.control.robust import load_control
    from pkm_core.identification.bag_data import read_cell_bag
    from pkm_core.identification.identify import identify_joint

    believed, gains = load_model(system), load_control(system, control or None)
    records, notes = [], []
    for bag in bags:
        record, warnings = read_cell_bag(system, bag, namespace)
        records.append(record)
        notes += warnings
    found = {}
    for joint in joints or system.joints:
        if joints or any(record.moves_plainly(system, joint) for record in records):
            found[joint] = identify_joint(system, joint, records, believed, gains, band=band, modes=modes)
    if not found:
        raise PkmError(f'no axis of {system.name} moves without excitation in these bags; K and a need plain moves')
    return found, notes, believed


def _foreign_axis(bags, signals, delay, limit, band, modes):
    """Return what was identified of somebody else's axis, under the name 'axis', and notes on the bags."""
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
    uncertain = 0.25 * data.sample_time  # nobody has said how well the delay is known
    axis = identify_axis('axis', moves, responses, delay=dead_time, delay_deviation=uncertain, modes=modes)
    return {'axis': axis}, notes
