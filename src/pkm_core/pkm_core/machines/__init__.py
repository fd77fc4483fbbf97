"""The machines: kinematics, limits, rigid dynamics and drive data of the nominal design, with one interface."""

from pkm_core.config import Configuration, parse_config, read_yaml
from pkm_core.config_errors import short
from pkm_core.errors import ConfigError
from pkm_core.machines.base import Limits, Machine
from pkm_core.machines.four_dof import FourDof
from pkm_core.machines.kinematic import Layout, Linkage
from pkm_core.machines.planar import Planar
from pkm_core.machines.xy_stage import XyStage

__all__ = ['FourDof', 'Layout', 'Limits', 'Linkage', 'Machine', 'Planar', 'XyStage', 'load_machine']

_MECHANISMS = {'four_dof': FourDof, 'planar': Planar, 'xy_stage': XyStage, 'linkage': Linkage, 'layout': Layout}


def load_machine(name_or_path, configuration=None) -> Machine:
    """
    Return the machine of config/machines/NAME.yaml or of a path; its name is that of the file.

    Its models, gains, truth and motions are read from the same `configuration`, by default that of the environment.

    Raises
    ------
    ConfigError
        If there is no such file or a value is refused; the message has file, key, value and allowed range.

    """
    configuration = configuration or Configuration.of_environment()
    path = configuration.find('machines', name_or_path)
    data = read_yaml(path)
    given = data.get('mechanism')
    mechanism = _MECHANISMS.get(given) if isinstance(given, str) else None
    if mechanism is None:
        raise ConfigError(f'{path}: mechanism: {short(given)} given; known: {sorted(_MECHANISMS)}')
    machine = mechanism(parse_config(data, mechanism.Config, where=str(path)), path.stem, configuration)
    require_specimen(path, machine)
    return machine


def require_specimen(path, machine):
    """Refuse a section `built` without its specimen, or of another machine than the name of the file: `ConfigError`."""
    if getattr(machine.config, 'built', None) is None:
        return
    if machine.specimen is None:
        raise ConfigError(
            f'{path}: built.specimen: is missing; expected the machine that was measured, as pkm calibrate writes it, '
            f'or {{machine: {machine.name}, origin: measured machine}}'
        )
    if machine.specimen.machine != machine.name:
        raise ConfigError(
            f'{path}: built.specimen: lengths of {machine.specimen}; expected those of {machine.name}, the name of the '
            'file'
        )
