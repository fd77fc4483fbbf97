"""`pkm drive-response`: frequency response of the current loop of the amplifiers."""

import numpy as np

from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, table
from pkm_core.verbs.options import JsonOption, MachineOption, OutOption, OverwriteOption, out_folder, write_figures

_ROWS = {  # heading: (key, factor, figure of the thesis)
    '-3 dB at [kHz]': ('corner_hz', 1e-3, '7.42'),
    'phase at 1 kHz [deg]': ('phase_at_1_khz_deg', 1.0, '-8.72'),
    'gain at 1 kHz [dB]': ('gain_at_1_khz_db', 1.0, ''),
    'gain at 2 kHz [dB]': ('gain_at_2_khz_db', 1.0, 'begins to fall'),
}


def drive_response(
    machine_name: MachineOption = 'four_dof',
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Compute the frequency response of the current loop from its equations and by swept sine from 100 Hz to 10 kHz.

    Writes Fig. 6.10 of the thesis into --out.

    Example: `pkm drive-response --out runs/drive`
    """
    from pkm_core.experiments.drive_response import draw, figures, sweep
    from pkm_core.plant.plant import Plant

    console, machine, out = Output(), load_machine(machine_name), out_folder(out)
    drive = Plant(machine, 0, 'ideal').truth.drive
    result = figures(drive)
    rows = [
        (heading, *(f'{factor * result[way][key]:.3f}' for way in ('equations', 'swept_sine')), thesis)
        for heading, (key, factor, thesis) in _ROWS.items()
    ]
    title = f'current loop of {machine.name}, (6.1)-(6.3), Fig. 6.10'
    console.print(table(title, ['', 'equations', 'swept sine', 'thesis'], rows))
    frequencies, equations, measured = sweep(drive)
    if out:
        draw(out, frequencies, equations, measured)
        console.plain(f'the figure is in {out}')
    responses = {
        way: {'gain_db': 20.0 * np.log10(np.abs(response / response[0])), 'phase_deg': np.degrees(np.angle(response))}
        for way, response in (('equations', equations), ('swept_sine', measured))
    }
    write_figures(json_file, {'machine': machine.name, **result, 'sweep': {'frequency_hz': frequencies, **responses}})
