"""`pkm margins`: what the loops of a machine tolerate, by their models and over the perturbed models."""

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pkm_core.machines import load_machine
from pkm_core.verbs.options import JsonOption, MachineOption, folder, write_json


class Law(StrEnum):
    """Which controller."""

    robust = 'robust'
    computed_torque = 'computed_torque'


def margins(
    machine: MachineOption = 'four_dof',
    law: Annotated[Law, typer.Option(help='Which controller.')] = Law.robust,
    control: Annotated[
        str,
        typer.Option(
            help="Gains: a file of config/control or its folder computed_torque, or a YAML file; default: the machine's"
        ),
    ] = '',
    out: Annotated[Path | None, typer.Option(help='Folder for pictures; none are made without it.')] = None,
    json_file: JsonOption = None,
):
    """
    Show gain and phase margin, sensitivity, disk margin and bandwidths of every axis.

    Each of the model, and the worst over gain +-20 %, modes +-5 % and all signs of the zeros. Of computed torque also
    the natural frequency up to which the flexible modes let it keep the limits of config/tuning.

    Example: `pkm margins --machine planar --out runs/margins`

    Example: `pkm margins --law computed_torque --json limits.json`
    """
    from pkm_core.control.computed_torque import load_torque_control
    from pkm_core.control.margins import stability_margins, worst_margins
    from pkm_core.control.model import load_model
    from pkm_core.control.robust import load_control

    console, system, out = Console(), load_machine(machine), folder(out)
    models = load_model(system)
    if law is Law.robust:
        laws = gains = load_control(system, control or None)
    else:
        gains = load_torque_control(system, control or None)
        laws = {joint: gains[joint].pid(models[joint]) for joint in system.joints}
    found = {
        joint: {
            'nominal': stability_margins(laws[joint], models[joint], system.sample_time),
            'worst': worst_margins(laws[joint], models[joint], system.sample_time),
        }
        for joint in system.joints
    }
    results = {
        'machine': system.name,
        'law': law.value,
        'control': control or system.name,
        'axes': {joint: {case: asdict(m) for case, m in cases.items()} for joint, cases in found.items()},
    }
    console.print(margins_table(f'{system.name}, {law.value}', found))
    if law is Law.computed_torque:
        results['natural_frequency_limits_Hz'] = _torque_limits(console, system, gains, models, out)
    write_json(json_file, results)
    if out:
        from pkm_core.control.margin_plots import model_loops, plot_margins

        for joint in system.joints:
            path = out / f'margins_{joint}.png'
            title = f'{system.name} {joint}, {law.value}; thin: perturbed models'
            plot_margins(path, title, *model_loops(laws[joint], models[joint], system.sample_time))
        console.print(f'pictures are in {out}', soft_wrap=True)


def margins_table(title, found):
    """Return the table of {joint: {case: Margins}}."""
    columns = {  # the rest of `Margins` is in the JSON
        'GM\n[dB]': ('gain_margin', '.2f'),
        'PM\n[deg]': ('phase_margin', '.1f'),
        'Smax': ('peak_sensitivity', '.2f'),
        'disk\nmargin': ('disk_margin', '.2f'),
        '|L| = 1\n[Hz]': ('crossover', '.1f'),
        '|S| < 1\n[Hz]': ('bandwidth', '.1f'),
        '|T|\n[Hz]': ('tracking_bandwidth', '.0f'),
    }
    table = Table(title=title, title_justify='left')
    table.add_column('axis')
    table.add_column('')
    for heading in columns:
        table.add_column(heading.replace('[', '\\['), justify='right')
    for joint, cases in found.items():
        for case, margins in cases.items():
            cells = (f'{getattr(margins, name):{form}}' for name, form in columns.values())
            table.add_row(joint if case == 'nominal' else '', case, *cells, end_section=case != 'nominal')
    return table


def _torque_limits(console, system, gains, models, out):
    """Print and return the natural frequencies at which computed torque loses its margins, with and without modes."""
    import numpy as np

    from pkm_core.tuning.config import load_tuning
    from pkm_core.tuning.torque_limits import limits_of, scan

    config, tried = load_tuning(), np.arange(5.0, 150.5, 0.5)
    table = Table(title='natural frequency [Hz] up to which ...', title_justify='left')
    table.add_column('axis')
    for heading in ('now', 'all limits\nare kept', 'margins\nare kept', 'perturbed\nare stable', 'model\nis stable'):
        table.add_column(heading, justify='right')
    scans, limits = {}, {}
    for joint, model in models.items():
        rigid = model.model_copy(update={'modes': ()})
        scans[joint] = [scan(gains[joint], m, system.sample_time, config, tried) for m in (model, rigid)]
        limits[joint] = {'with modes': limits_of(scans[joint][0]), 'rigid': limits_of(scans[joint][1])}
        for case, found in limits[joint].items():
            now = f'{gains[joint].natural_frequency:g}' if case == 'with modes' else ''
            table.add_row(f'{joint} {case}', now, *(f'{value:g}' for value in found.values()))
    console.print(table)
    if out:
        from pkm_core.control.margin_plots import plot_torque_limits

        plot_torque_limits(out / 'torque_limits.png', f'{system.name}: computed torque', scans)
    return limits
