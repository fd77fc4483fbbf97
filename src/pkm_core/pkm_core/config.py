"""
Strict YAML to frozen models: every value has its unit; every error has file, key, value and allowed range.

Quantities in files have units (``l2: 70 mm``); models have SI floats. `load_config` refuses a number without its unit,
a unit of another dimension, an unknown or duplicate key, a NaN and a value out of range. Built from Python, the same
models take plain SI numbers.
"""

import hashlib
import os
import sys
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from pkm_core.config_errors import reasons_of, short
from pkm_core.errors import ConfigError
from pkm_core.quantities import to_si
from pkm_core.yaml_text import YamlError, parse_yaml, read_text

_FROM_FILE = {'from_file': True}
# per refusal; further reasons are counted
_MOST_REASONS = 5
_LONGEST_REFUSAL = 250  # characters
_USUAL = {'m': 'mm', 's': 'ms', 'rad': 'deg'}  # units for the example in an error message


class Config(BaseModel):
    """Base of every configuration model: frozen, no unknown keys, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra='forbid', allow_inf_nan=False, hide_input_in_errors=True)


def _to_si(value, unit, info):
    from_file = bool(info.context and info.context.get('from_file'))
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f'{value!r} is not a quantity; expected a number in {unit or "1"}')
    if isinstance(value, (int, float)):
        if from_file and unit:
            usual = _USUAL.get(unit, unit)
            raise ValueError(f"{value!r} has no unit; expected a quantity in {usual}, e.g. '{value} {usual}'")
        return float(value)
    return to_si(value, unit)


def quantity(unit):
    """
    Return the annotated float type of a field in `unit` (an SI unit; '' for a pure number).

    Add bounds in SI and the meaning of the key, which is shown in docs/parameters.md, with
    ``Annotated[quantity('m'), Field(gt=0, description='of the link')]``.
    """
    described = Field(json_schema_extra={'unit': unit})  # for docs/parameters.md
    return Annotated[float, BeforeValidator(lambda value, info: _to_si(value, unit, info)), described]


Number = quantity('')
Length = quantity('m')
Mass = quantity('kg')
Inertia = quantity('kg m^2')
Time = quantity('s')
Frequency = quantity('Hz')
Force = quantity('N')
Voltage = quantity('V')
Speed = quantity('m/s')
Angle = quantity('rad')


def read_yaml(path):
    """Return the mapping in the YAML file `path`; `ConfigError` if it cannot be read as one."""
    path = Path(path)
    try:
        data = parse_yaml(read_text(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ConfigError(f'{path}: cannot be read: {reason}') from None
    except YamlError as error:
        raise ConfigError(f'{path}: {error}') from None
    if not isinstance(data, dict):
        raise ConfigError(f'{path}: holds {type(data).__name__}; expected a mapping of keys')
    return data


def parse_config(data, model: type[Config], *, where: str, context=_FROM_FILE) -> Any:
    """
    Return `model` built from the mapping `data` of a file; errors begin with `where`.

    With `context` None the values are SI numbers of a program.
    """
    try:
        return model.model_validate(data, context=context)
    except ValidationError as error:
        reasons = reasons_of(error, model, data)
        lines = [f'{where}: {reason}' for reason in reasons]
        fitting = sum(length <= _LONGEST_REFUSAL for length in accumulate(map(len, reasons)))
        shown = min(max(1, fitting), _MOST_REASONS)
        if shown < len(lines):
            lines[shown:] = [f'{where}: and {len(lines) - shown} more']
        raise ConfigError('\n'.join(lines)) from None


def load_config(path, model: type[Config]) -> Any:
    """Return `model` read from the YAML file `path`; a `ConfigError` has file, key, value and allowed range."""
    return parse_config(read_yaml(path), model, where=str(path))


def install_prefixes() -> list[Path]:
    """Return the prefixes of installed packages: those of the sourced ROS workspaces, and that of this Python."""
    return [*map(Path, filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))), Path(sys.prefix)]


@dataclass(frozen=True)
class Configuration:
    """
    The folder of configuration files in use; every `Machine` has one as its attribute `configuration`.

    Attributes
    ----------
    folder : Path
        With one folder per kind of file: machines, model, control, truth, motions, learning, tuning, design.
    plugins : tuple of Path, optional
        Folders from which Python files of learning laws may be loaded. None allows any folder: for a program whose user
        names the file. Nodes, which get names by message, have a tuple.

    """

    folder: Path
    plugins: tuple[Path, ...] | None = None

    @classmethod
    def of_environment(cls) -> 'Configuration':
        """
        Return the configuration in $PKM_CONFIG, else that of the source tree, else the installed one.

        Raises
        ------
        ConfigError
            If $PKM_CONFIG is not a folder, or there is no configuration.

        """
        named = os.environ.get('PKM_CONFIG')
        if named:
            if not Path(named).is_dir():
                raise ConfigError(f'PKM_CONFIG: {named!r} given; expected a folder of configuration files')
            return cls(Path(named))
        beside = Path(__file__).resolve().parents[1] / 'config'
        candidates = [beside, *(prefix / 'share' / 'pkm_core' / 'config' for prefix in install_prefixes())]
        for folder in candidates:
            if folder.is_dir():
                return cls(folder)
        raise ConfigError(f'no config folder among {[str(folder) for folder in candidates]}; set PKM_CONFIG')

    def names(self, kind) -> list[str]:
        """Return the names of the files of a `kind`, sorted."""
        return sorted(path.stem for path in (self.folder / kind).glob('*.yaml'))

    def find(self, kind, name_or_path) -> Path:
        """
        Return the file of `name_or_path`: a path to a YAML file, or the name of a file of this `kind`.

        Raises
        ------
        ConfigError
            If there is none; the existing names are listed.

        """
        text = str(name_or_path)
        if text.endswith(('.yaml', '.yml')) or os.sep in text:
            path = Path(text)
            if _is_file(path):
                return path
            raise ConfigError(f'{text[:300]}: no such file')
        path = self.folder / kind / f'{text}.yaml'
        if not _is_file(path):
            raise ConfigError(f'{kind}: {short(text)} is unknown; {self.folder / kind} has {self.names(kind)}')
        return path


def _is_file(path):
    """Return whether `path` is a file; a name that no file can have is none."""
    try:
        return path.is_file()
    except OSError:  # a name of 5,000 characters
        return False


def find_config(kind, name_or_path, configuration=None) -> Path:
    """Return the result of `Configuration.find`, by default in the configuration of the environment."""
    return (configuration or Configuration.of_environment()).find(kind, name_or_path)


def hash_files(paths) -> str:
    """Return 12 hex digits that change when the content of any of the files `paths` changes."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(Path(path).read_bytes())
    return digest.hexdigest()[:12]
