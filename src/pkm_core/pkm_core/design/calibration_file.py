"""
Calibrated machines as files: each length and mark, and the machine file with the mean lengths.

A machine file has one length for links 2 to 8 and one for 10 and 12, so `load_machine` can take over their means only;
the calibration file keeps all.
"""

import re

from pkm_core.config import Config, Length, find_config, load_config
from pkm_core.design.calibration import CalibratedModel
from pkm_core.design.specimen import LINKS, OFFSETS, nominal_length
from pkm_core.errors import ConfigError


class CalibrationConfig(Config):
    """What a calibration file says of one built machine."""

    mechanism: str
    links: dict[str, Length]
    offsets: dict[str, Length]
    encoder_offsets: dict[str, Length]  # reading minus position


def write_calibration(path, calibration, source):
    """Write the `Calibration` to the YAML file `path`; `source` says in words what it was made from."""
    machine, errors = calibration.model.machine, calibration.model.errors
    mechanism = machine.config.mechanism

    def origin(name):
        return f'  # +- {1e6 * calibration.deviations[name]:.2f} um, calibrated'

    lines = [
        f'# {machine.name} calibrated from {source}. +-: standard deviation of the estimate.',
        f'mechanism: {mechanism}',
    ]
    lines.append('links:')
    for name in LINKS[mechanism]:
        lines.append(f'  {name}: {1e3 * (nominal_length(machine, name) + errors[name]):.6f} mm{origin(name)}')
    lines.append('offsets:')
    for name in OFFSETS[mechanism]:
        lines.append(f'  {name}: {1e3 * (getattr(machine.config.geometry, name) + errors[name]):.6f} mm{origin(name)}')
    lines.append('encoder_offsets:  # reading minus position')
    for name in machine.joints:
        lines.append(f'  {name}: {1e6 * errors[name]:.3f} um{origin(name)}')
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')


def load_calibration(path, machine):
    """
    Return the `CalibratedModel` of `machine` that the YAML file `path` holds.

    Raises
    ------
    ConfigError
        If the file is refused or belongs to another mechanism.

    """
    config = load_config(path, CalibrationConfig)
    mechanism, geometry = machine.config.mechanism, machine.config.geometry
    if config.mechanism != mechanism:
        raise ConfigError(f'{path}: mechanism: {config.mechanism!r} given; {machine.name} is a {mechanism!r}')
    drawn = {
        'links': {name: nominal_length(machine, name) for name in LINKS[mechanism]},
        'offsets': {name: getattr(geometry, name) for name in OFFSETS[mechanism]},
        'encoder_offsets': dict.fromkeys(machine.joints, 0.0),
    }
    errors = {}
    for section, nominal in drawn.items():
        given = getattr(config, section)
        if set(given) != set(nominal):
            raise ConfigError(f'{path}: {section}: {sorted(given)} given; expected {sorted(nominal)}')
        errors |= {name: given[name] - nominal[name] for name in nominal}
    return CalibratedModel(machine, errors)


def write_mean_machine(path, machine_name, calibration):
    """Write a copy of the machine file `machine_name` to `path` with the mean calibrated lengths in it."""
    machine, errors = calibration.model.machine, calibration.model.errors
    text = find_config('machines', machine_name).read_text(encoding='utf-8')
    links = LINKS[machine.config.mechanism]
    for key, first in (('l2', 'l'), ('k10', 'k')):
        lengths = [nominal_length(machine, name) + errors[name] for name in links if name.startswith(first)]
        if lengths:
            mean = 1e3 * sum(lengths) / len(lengths)
            text, found = re.subn(rf'(?m)^(\s+{key}:).*$', rf'\1 {mean:.6f} mm  # calibrated: mean of its links', text)
            if found != 1:
                raise ConfigError(f'{machine_name}: {key} stands {found} times on a line of its own; expected once')
    path.write_text(text, encoding='utf-8')
