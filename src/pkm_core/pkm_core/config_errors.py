"""Refused values of configuration models as one sentence each: key, what came, what is allowed."""

import reprlib
from typing import get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

LONGEST_REASON = 250  # characters
# what is allowed, by the type of a pydantic error; fields in braces are of its context
_ALLOWED = {
    'greater_than': '> {gt:g}',
    'greater_than_equal': '>= {ge:g}',
    'less_than': '< {lt:g}',
    'less_than_equal': '<= {le:g}',
    'finite_number': 'a finite number',
    'literal_error': '{expected}',
    'too_long': 'at most {max_length} entries',
    **dict.fromkeys(('int_type', 'int_parsing', 'int_from_float', 'int_parsing_size'), 'an integer'),
    **dict.fromkeys(('float_type', 'float_parsing'), 'a number'),
    **dict.fromkeys(('string_type', 'string_unicode'), 'a text'),
    **dict.fromkeys(('bool_type', 'bool_parsing'), 'true or false'),
    **dict.fromkeys(('model_type', 'model_attributes_type', 'dict_type', 'mapping_type'), 'a mapping of keys'),
    **dict.fromkeys(('tuple_type', 'list_type'), 'a list'),
}
_BOUNDS = ('greater_than', 'greater_than_equal', 'less_than', 'less_than_equal')


def reasons_of(error, model, data):
    """
    Return one sentence for each cause of the pydantic `ValidationError` of `model` for the mapping `data`.

    An error that only follows from others is left out: a list is not empty because its entry is refused.
    """
    errors = error.errors()
    places = [item['loc'] for item in errors]

    def follows(place):
        return any(other[: len(place)] == place and other != place for other in places)

    causes = [item for item in errors if not (item['type'] == 'too_short' and follows(item['loc']))]
    return list(dict.fromkeys(_cut(_explain(item, model, data)) for item in causes))


def allowed(error, model):
    """Return what the field of `model` named by an item of `ValidationError.errors()` allows, with its unit."""
    kind = error['type']
    if kind not in _ALLOWED:
        return error['msg'][0].lower() + error['msg'][1:]
    unit = _unit(model, error['loc']) if kind in _BOUNDS else ''
    return f'{_ALLOWED[kind].format(**error.get("ctx", {}))} {unit}'.strip()


def short(value):
    """Return the repr of a value for a message, at most about 100 characters."""
    shown = reprlib.Repr()
    shown.maxstring = shown.maxother = shown.maxlong = 80
    return shown.repr(value)


def _cut(text):
    return text if len(text) <= LONGEST_REASON else f'{text[:LONGEST_REASON]}...'


def _explain(error, model, data):
    location, kind, context = error['loc'], error['type'], error.get('ctx', {})
    key = '.'.join(str(part)[:80] for part in location)
    if kind == 'extra_forbidden':
        known = _known_keys(model, location[:-1])
        return f'unknown key {key!r}' + (f'; known: {known}' if known else '')
    if kind == 'missing':
        return f'{key}: is missing'
    if kind == 'too_short':
        return f'{key}: has {context["actual_length"]} entries; expected at least {context["min_length"]}'
    if kind == 'value_error':
        reason = str(context['error'])
        return f'{key}: {reason}' if key else reason
    return f'{key}: {short(_lookup(data, location))} given; allowed {allowed(error, model)}'


def _lookup(data, location):
    for part in location:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _model_in(annotation):
    """Return the model of an annotation such as `Model | None`, or None."""
    choices = get_args(annotation) or (annotation,)
    return next((each for each in choices if isinstance(each, type) and issubclass(each, BaseModel)), None)


def _known_keys(model, location):
    for part in location:
        fields = model.model_fields
        model = _model_in(fields[part].annotation) if isinstance(part, str) and part in fields else None
        if model is None:
            return None
    return sorted(model.model_fields)


def _unit(model, location):
    """Return the SI unit of the quantity at `location`, '' if it is none."""
    unit = ''
    for part in location:
        if model is None or part not in model.model_fields:
            break
        field = model.model_fields[part]
        unit, model = _unit_in(field), _model_below(field.annotation)
    return unit


def _model_below(annotation):
    """Return the model anywhere in an annotation, as in ``dict[str, Model]``, or None."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_model_below, get_args(annotation))), None)


def _unit_in(part):
    """Return the unit in a field or anywhere in its annotation, as in ``tuple[Length, Length]``."""
    if isinstance(part, FieldInfo):
        extra = part.json_schema_extra
        return (extra.get('unit') if isinstance(extra, dict) else None) or _unit_in(part.annotation)
    metadata = getattr(part, '__metadata__', ())
    return next(filter(None, map(_unit_in, (*metadata, *get_args(part)))), '')
