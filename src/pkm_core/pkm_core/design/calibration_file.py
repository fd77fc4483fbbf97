"""Write a calibrated machine: its machine file with a section `built`, read by every command and node."""

import re

from pkm_core.config import find_config
from pkm_core.machines.identity import Specimen


def write_calibrated_machine(path, machine_name, calibration, source, configuration=None):
    """
    Write a copy of the machine file `machine_name` with the result of the `Calibration` to `path`.

    `source` is a text that names the origin of the measurements. Keep the file name of the machine: models, gains and
    learned signals are found by it. The file names the specimen of the measurements; without one they are of a real
    machine. `configuration` is where the name is found, by default that of the environment.
    """
    built = calibration.machine.config.built
    specimen = built.specimen or Specimen.measured(calibration.machine.name)
    named = specimen.model_dump(exclude_none=True)
    lines = [
        f'built:  # calibrated from {source}; +- standard deviation of the estimate',
        '  specimen: {' + ', '.join(f'{key}: {value}' for key, value in named.items()) + '}',
    ]

    def line(indent, name, length):
        return f'{indent}{name}: {1e3 * length:.6f} mm  # +- {1e6 * calibration.deviations[name]:.2f} um'

    lines += [line('  ', name, length) for name, length in built.lengths().items()]
    lines.append('  marks:  # encoder reading minus position')
    lines += [line('    ', joint, mark) for joint, mark in built.marks]
    if built.uncertainty is not None:
        lines += built.uncertainty.lines('  ')
    text = find_config('machines', machine_name, configuration).read_text(encoding='utf-8')
    text = re.sub(r'(?ms)^built:.*?(?=^\S|\Z)', '', text)  # remove an earlier calibration
    path.write_text(text.rstrip('\n') + '\n\n' + '\n'.join(lines) + '\n', encoding='utf-8')
