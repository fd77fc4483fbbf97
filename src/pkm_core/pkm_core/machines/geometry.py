"""Exchange of the geometry of a machine: the same machine with other measured lengths."""

import hashlib
from dataclasses import dataclass

from pkm_core.config import find_config, parse_config
from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine, require_specimen
from pkm_core.machines.base import Machine
from pkm_core.yaml_text import YamlError, parse_yaml


@dataclass(frozen=True)
class Geometry:
    """A machine with the machine file it was read from."""

    machine: Machine
    file: str
    text: str  # content of the file

    @property
    def digest(self):
        """12 hex digits that change with every number of the file, but not with its comments."""
        numbers = f'{self.machine.name} {self.machine.config.model_dump_json()}'
        return hashlib.sha256(numbers.encode()).hexdigest()[:12]

    @property
    def is_calibrated(self):
        """Whether the file has measured lengths."""
        return getattr(self.machine.config, 'built', None) is not None

    @property
    def file_hash(self):
        """The `pkm_core.recording.provenance.machine_hash` of the file."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:12]

    def exchanged(self, file, text):
        """
        Return the `Geometry` of `text`, the content of the machine file `file`; nothing is opened.

        Raises
        ------
        ConfigError
            If it is not a machine file, or differs from this machine in anything but the section `built`.

        """
        present = self.machine
        try:
            data = parse_yaml(text)
        except YamlError as error:
            raise ConfigError(f'{file}: {error}') from None
        if not isinstance(data, dict) or data.get('mechanism') != present.config.mechanism:
            found = data.get('mechanism') if isinstance(data, dict) else None
            raise ConfigError(
                f'{file}: mechanism: {found!r} given; expected {present.config.mechanism!r}, as {present.name} has'
            )
        config = parse_config(data, type(present).Config, where=str(file))
        for key, value in present.config:
            if key != 'built' and getattr(config, key) != value:
                raise ConfigError(
                    f'{file}: {key} differs from that of {present.name} in this cell; allowed: a file that differs in '
                    f'the section built only'
                )
        machine = type(present)(config, present.name, present.configuration)
        require_specimen(file, machine)
        return Geometry(machine, str(file), text)


def load_geometry(name_or_path, configuration=None):
    """Return the `Geometry` of config/machines/NAME.yaml or of a path; arguments and errors of `load_machine`."""
    machine = load_machine(name_or_path, configuration)
    path = find_config('machines', name_or_path, machine.configuration)
    return Geometry(machine, str(name_or_path), path.read_bytes().decode())  # every byte counts in `file_hash`
