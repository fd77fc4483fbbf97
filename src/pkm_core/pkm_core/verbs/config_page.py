"""All keys of the configuration files as Markdown tables, generated from the models: for docs/parameters.md."""

import inspect
import re
from typing import get_args

from pkm_core.config import Config
from pkm_core.control.computed_torque import TorqueControlFile
from pkm_core.control.model import ModelFile
from pkm_core.control.robust import ControlFile
from pkm_core.design.measurement import LaserConfig
from pkm_core.design.operational_workspace import OperationalWorkspace
from pkm_core.design.tolerances import Tolerances
from pkm_core.learning import KINDS
from pkm_core.machines import FourDof, Planar, XyStage
from pkm_core.motion.planning import Motion
from pkm_core.plant.truth import Truth
from pkm_core.tuning.config import TuningConfig

MACHINES = (FourDof, Planar, XyStage)
FILES = {
    **{f'config/machines, {get_args(m.Config.model_fields["mechanism"].annotation)[0]}': m.Config for m in MACHINES},
    'config/model': ModelFile,
    'config/control': ControlFile,
    'config/control/computed_torque': TorqueControlFile,
    **{f'config/learning, law {name}': law.Parameters for name, law in KINDS.items()},
    'config/motions': Motion,
    'config/tuning': TuningConfig,
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
    """Return one section with a table per entry of `FILES`."""
    return '\n'.join(_section(title, model) for title, model in FILES.items())


def table(headings, rows):
    """Return a Markdown table."""
    lines = [headings, ['---'] * len(headings), *rows]
    return ''.join(f'| {" | ".join(cell.replace("|", chr(92) + "|") for cell in line)} |\n' for line in lines)


def _section(title, model):
    schema = model.model_json_schema()
    classes = {}
    _collect(model, classes)
    rows = list(_rows(schema, schema.get('$defs', {}), classes, ''))
    return f'### {title}\n\n{inspect.getdoc(model)}\n\n' + table(
        ['key', 'unit or type', 'allowed', 'default', ''], rows
    )


def _collect(annotation, classes):
    """Add the models that `annotation` contains to `classes`, {name: class}."""
    if isinstance(annotation, type) and issubclass(annotation, Config) and annotation.__name__ not in classes:
        classes[annotation.__name__] = annotation
        for field in annotation.model_fields.values():
            _collect(field.annotation, classes)
    for part in get_args(annotation):
        _collect(part, classes)


def _rows(schema, models, classes, prefix):
    """Yield (key, unit or type, allowed, default, meaning) per key below `prefix`; equal keys share a row."""
    model = classes.get(schema.get('title'))
    comments = _comments(model)
    # the docstring of a section is on its first row
    about = ' '.join((inspect.getdoc(model) or '').split()) if model and prefix else ''
    together = {}
    for name, field in schema.get('properties', {}).items():
        required = name in schema.get('required', ())
        together.setdefault(_Hashable(field, required, comments.get(name, '')), []).append(name)
    for (field, required, meaning), names in together.items():
        key = prefix + (names[0] if len(names) == 1 else f'{{{", ".join(names)}}}')
        default = '' if required else 'absent' if field.get('default') is None else f'{field["default"]}'
        yield from _field(key, field, models, classes, default, meaning or about)
        about = ''


def _field(key, field, models, classes, default, meaning):
    """Yield the rows of one key: its own, or those of its section, list or mapping."""
    choices = [choice for choice in field.get('anyOf', ()) if choice.get('type') != 'null']
    if choices:
        field = {**field, **choices[0]}
    if '$ref' in field:
        optional = ' (section may be absent)' if choices else ''
        for row in _rows(models[field['$ref'].rpartition('/')[2]], models, classes, f'{key}.'):
            yield (*row[:-1], row[-1] + optional)
            optional = ''
    elif field.get('type') == 'object' and isinstance(field.get('additionalProperties'), dict):
        yield from _field(f'{key}.NAME', field['additionalProperties'], models, classes, default, meaning)
    elif field.get('type') == 'array' and '$ref' in field.get('items', {}):
        yield from _field(f'{key}[]', field['items'], models, classes, default, meaning)
    else:
        yield f'`{key}`', _kind(field), _allowed(field), default, meaning


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


def _comments(model):
    """Return {field: comment on its line} of a model and its base classes."""
    found = {}
    for each in reversed(model.__mro__ if model else ()):
        if issubclass(each, Config) and each is not Config:
            found |= dict(re.findall(r'(?m)^ {4,8}(\w+): .*?  # (.*?)(?:  # noqa.*)?$', inspect.getsource(each)))
    return found


class _Hashable(tuple):
    """A field, whether it is required, and its meaning; equal to one that differs only in the title."""

    def __new__(cls, field, required, meaning):
        return super().__new__(cls, (field, required, meaning))

    def __hash__(self):
        return hash(repr(self._key()))

    def __eq__(self, other):
        return self._key() == other._key()

    def _key(self):
        field, required, meaning = self
        return {name: value for name, value in field.items() if name != 'title'}, required, meaning
