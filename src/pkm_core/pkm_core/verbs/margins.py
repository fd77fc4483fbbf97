"""`pkm margins`: stability margins of the axes of a machine, nominal and worst of the perturbed models."""

from dataclasses import asdict

from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, table
from pkm_core.verbs.options import (
    ControllerOption,
    JsonOption,
    MachineOption,
    OutOption,
    OverwriteOption,
    out_folder,
    write_figures,
)


def margins(
    machine_name: MachineOption = 'four_dof',
    controller: ControllerOption = 'robust',
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Compute gain and phase margin, peak sensitivity, disk margin and bandwidths of every axis.

    Nominal model, and worst case over gain +-20 %, modes +-5 % and all signs of the zeros; for an observer law over
    gain +-10 % and modes +-3 %, the uncertainty of an identified model. A second table has the margins and closed-loop
    bandwidths of the thesis's robust law, Tables 7.1 and 8.1, beside those of the model. With computed torque also the
    highest natural frequency at which the limits of config/tuning are kept despite the flexible modes.

    Example: `pkm margins --machine planar --out runs/margins`

    Example: `pkm margins --controller observer`

    Example: `pkm margins --controller computed_torque --json limits.json`
    """
    from pkm_core.control.controllers import KINDS, SINGLE_AXIS, choose_control, kind_of
    from pkm_core.control.margins import stability_margins, worst_margins
    from pkm_core.control.model import load_model
    from pkm_core.thesis.gains import NUMBERS

    console, machine, out = Output(), load_machine(machine_name), out_folder(out)
    models, gains = load_model(machine), choose_control(machine, controller)
    kind = kind_of(gains)
    laws = gains if kind in SINGLE_AXIS else {joint: gains[joint].pid(models[joint]) for joint in machine.joints}
    found = {
        joint: {
            'nominal': stability_margins(laws[joint], models[joint], machine.sample_time),
            'worst': worst_margins(laws[joint], models[joint], machine.sample_time),
        }
        for joint in machine.joints
    }
    results = {
        'machine': machine.name,
        'law': kind,
        'control': machine.name if controller in KINDS else controller,
        'axes': {joint: {case: asdict(m) for case, m in cases.items()} for joint, cases in found.items()},
    }
    console.print(margins_table(f'{machine.name}, {kind}', found))
    if machine.name in NUMBERS:
        reported = _thesis_rows(machine.name, found)
        results['thesis'] = {row[0]: row[1:] for row in reported}
        console.print(_thesis_table(machine.name, reported))
    if kind == 'computed_torque':
        results['natural_frequency_limits_Hz'] = _torque_limits(console, machine, gains, models, out)
    write_figures(json_file, results)
    if out:
        from pkm_core.control.margin_plots import model_loops, plot_margins

        for joint in machine.joints:
            path = out / f'margins_{joint}.png'
            title = f'{machine.name} {joint}, {kind}; thin: perturbed models'
            plot_margins(path, title, *model_loops(laws[joint], models[joint], machine.sample_time))
        console.plain(f'figures are in {out}')


def margins_table(title, found):
    """Return the table of `found`, {joint: {'nominal': Margins, 'worst': Margins}}."""
    columns = {  # the other fields of `Margins` are in the JSON file
        'GM\n[dB]': ('gain_margin', '.2f'),
        'PM\n[deg]': ('phase_margin', '.1f'),
        'Smax': ('peak_sensitivity', '.2f'),
        'disk\nmargin': ('disk_margin', '.2f'),
        '|L| = 1\n[Hz]': ('crossover', '.1f'),
        '|S| < 1\n[Hz]': ('bandwidth', '.1f'),
        '|T|\n[Hz]': ('tracking_bandwidth', '.0f'),
    }
    rows: list = []
    for joint, cases in found.items():
        for case, margins in cases.items():
            cells = (f'{getattr(margins, name):{form}}' for name, form in columns.values())
            rows.append((joint if case == 'nominal' else '', case, *cells))
        rows.append(None)
    return table(title, ['axis', '', *columns], rows, align='llr')


def _thesis_rows(machine_name, found):
    """Return [joint, GM, PM, CLBW of the thesis, the same of the model] of each axis; CLBW is where |S| reaches 1."""
    from pkm_core.thesis.gains import ROWS, printed_column

    rows = []
    for joint, cases in found.items():
        printed = dict(zip(ROWS, printed_column(machine_name, joint), strict=True))
        own = cases['nominal']
        values = [printed[name] for name in ('GM (dB)', 'PM (deg)', 'CLBW (Hz)')]
        rows.append([joint, *values, own.gain_margin, own.phase_margin, own.bandwidth])
    return rows


def _thesis_table(machine_name, rows):
    from pkm_core.thesis.gains import NUMBERS

    forms = ('.2f', '.1f', '.1f')
    cells = [
        (joint, *(f'{value:{form}}' for value, form in zip(values, 2 * forms, strict=True))) for joint, *values in rows
    ]
    headings = [f'{whose}\n{what}' for whose in ('thesis', 'here') for what in ('GM [dB]', 'PM [deg]', 'CLBW [Hz]')]
    title = f'beside Table {NUMBERS[machine_name]} of the thesis, its robust law; CLBW: |S| < 1'
    return table(title, ['axis', *headings], cells)


def _torque_limits(console, machine, gains, models, out):
    """Print and return the natural frequencies at which computed torque loses its margins, with and without modes."""
    import numpy as np

    from pkm_core.tuning.config import load_tuning
    from pkm_core.tuning.torque_limits import limits_of, scan

    config, tried = load_tuning(), np.arange(5.0, 150.5, 0.5)
    scans, limits, rows = {}, {}, []
    for joint, model in models.items():
        rigid = model.model_copy(update={'modes': ()})
        scans[joint] = [scan(gains[joint], m, machine.sample_time, config, tried) for m in (model, rigid)]
        limits[joint] = {'with modes': limits_of(scans[joint][0]), 'rigid': limits_of(scans[joint][1])}
        for case, found in limits[joint].items():
            now = f'{gains[joint].natural_frequency:g}' if case == 'with modes' else ''
            rows.append((f'{joint} {case}', now, *(f'{value:g}' for value in found.values())))
    headings = ('now', 'all limits\nare kept', 'margins\nare kept', 'perturbed\nare stable', 'model\nis stable')
    console.print(table('natural frequency [Hz] up to which ...', ['axis', *headings], rows))
    if out:
        from pkm_core.control.margin_plots import plot_torque_limits

        plot_torque_limits(out / 'torque_limits.png', f'{machine.name}: computed torque', scans)
    return limits
