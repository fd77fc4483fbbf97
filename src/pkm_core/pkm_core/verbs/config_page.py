"""Tables of every key of the configuration files, from the JSON schemas of their models: docs/parameters.md."""

from typing import get_args

from pkm_core.control.computed_torque import TorqueControlFile
from pkm_core.control.model import ModelFile
from pkm_core.control.observer import ObserverFile
from pkm_core.control.robust import ControlFile
from pkm_core.design.measurement import LaserConfig
from pkm_core.design.operational_workspace import OperationalWorkspace
from pkm_core.design.tolerances import Tolerances
from pkm_core.learning import KINDS
from pkm_core.learning.tool_law import ToolLawConfig
from pkm_core.machines import FourDof, Layout, Linkage, Planar, XyStage
from pkm_core.motion.planning import Motion
from pkm_core.plant.truth import Truth
from pkm_core.tuning.config import ObserverTuning, TuningConfig

MACHINES = (FourDof, Planar, XyStage, Linkage, Layout)
FILES = {
    **{f'config/machines, {get_args(m.Config.model_fields["mechanism"].annotation)[0]}': m.Config for m in MACHINES},
    'config/model': ModelFile,
    'config/control': ControlFile,
    'config/control/computed_torque': TorqueControlFile,
    'config/control/observer': ObserverFile,
    **{f'config/learning, law {name}': law.Parameters for name, law in KINDS.items()},
    'config/learning/tool': ToolLawConfig,
    'config/motions': Motion,
    'config/tuning': TuningConfig,
    'config/tuning/observer.yaml': ObserverTuning,
    'config/design/chapter4.yaml': OperationalWorkspace,
    'config/design/tolerances.yaml': Tolerances,
    'config/design/laser.yaml': LaserConfig,
    'config/truth': Truth,
}
_BOUNDS = {
    'gt': '>', 'exclusiveMinimum': '>', 'ge': '>=', 'minimum': '>=',
    'lt': '<', 'exclusiveMaximum': '<', 'le': '<=', 'maximum': '<=',
}  # fmt: skip
_TYPES = {'integer': 'whole number', 'string': 'text', 'boolean': 'true or false', 'number': 'number'}


def config_page():
    """Return the tables of `FILES`, one section per model."""
    return '\n'.join(_section(title, model) for title, model in FILES.items())


def table(headings, rows):
    """Return a Markdown table."""
    lines = [headings, ['---'] * len(headings), *rows]
    return ''.join(f'| {" | ".join(cell.replace("|", chr(92) + "|") for cell in line)} |\n' for line in lines)


def _section(title, model):
    schema = model.model_json_schema()
    rows = list(_rows(schema, schema.get('$defs', {}), ''))
    headings = ['key', 'unit or type', 'allowed', 'default', '']
    return f'### {title}\n\n{schema["description"]}\n\n' + table(headings, rows)


def _rows(schema, models, prefix):
    """Yield (key, unit or type, allowed, default, meaning) of each key below `prefix`; equal keys share a row."""
    together = {}
    for name, field in schema.get('properties', {}).items():
        together.setdefault(_Comparable(field, name in schema.get('required', ())), []).append(name)
    for (field, required), names in together.items():
        key = prefix + (names[0] if len(names) == 1 else f'{{{", ".join(names)}}}')
        default = '' if required else 'absent' if field.get('default') is None else f'{field["default"]}'
        yield from _field(key, field, models, default)


def _field(key, field, models, default):
    """Yield the rows of one key and of the section, list or mapping it holds."""
    choices = [choice for choice in field.get('anyOf', ()) if choice.get('type') != 'null']
    field = {**field, **choices[0]} if choices else field
    meaning = _meaning(field)
    if '$ref' in field:
        section = models[field['$ref'].rpartition('/')[2]]
        yield f'`{key}`', 'section', '', default, meaning or _meaning(section)
        yield from _rows(section, models, f'{key}.')
    elif field.get('type') == 'object' and isinstance(field.get('additionalProperties'), dict):
        yield from _field(f'{key}.NAME', {'description': meaning, **field['additionalProperties']}, models, default)
    elif field.get('type') == 'array' and '$ref' in field.get('items', {}):
        yield from _field(f'{key}[]', {'description': meaning, **field['items']}, models, default)
    else:
        yield f'`{key}`', _kind(field), _allowed(field), default, meaning


def _meaning(schema):
    return ' '.join(schema.get('description', '').split())


def _kind(field):
    if field.get('type') == 'array':
        parts = field.get('prefixItems') or [field.get('items', {})]
        return f'list of {len(parts) if "prefixItems" in field else "any number of"} x {_kind(parts[0])}'
    if 'unit' in field:
        return field['unit'] or '1'
    return _TYPES.get(field.get('type'), 'text')


def _allowed(field):
    if field.get('type') == 'array':
        return _allowed((field.get('prefixItems') or [field.get('items', {})])[0])
    if 'enum' in field or 'const' in field:
        return ', '.join(str(value) for value in field.get('enum', [field.get('const')]))
    return ', '.join(f'{sign} {field[name]:g}' for name, sign in _BOUNDS.items() if name in field)


class _Comparable(tuple):
    """A field's schema and whether it is required; equal to one that differs only in its title."""

    def __new__(cls, field, required):
        return super().__new__(cls, (field, required))

    def __hash__(self):
        return hash(repr(self._key()))

    def __eq__(self, other):
        return self._key() == other._key()

    def _key(self):
        field, required = self
        return {name: value for name, value in field.items() if name != 'title'}, required
