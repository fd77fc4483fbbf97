"""Messages as YAML and CSV and back, in the form of ros2cli; the package that ros2cli uses is not on PyPI."""

import array
import sys

import numpy as np
import yaml
from builtin_interfaces.msg import Time
from rosidl_parser.definition import AbstractNestedType, AbstractWString, Array, BoundedSequence, NamespacedType
from std_msgs.msg import Header

from pkm_nodes.messages.interfaces import find_interface


def parse_yaml(text):
    """Return the value of a YAML text of the command line."""
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise RuntimeError(f"Not valid YAML: '{text}': {getattr(error, 'problem', error)}") from error


class _Dumper(yaml.Dumper):
    """Writes a message as a block even in flow style, and bytes as text, one character per byte."""


_Dumper.add_representer(
    dict, lambda dumper, data: dumper.represent_mapping('tag:yaml.org,2002:map', data, flow_style=False)
)
_Dumper.add_representer(bytes, lambda dumper, data: dumper.represent_str(data.decode('latin-1')))


def message_to_yaml(msg, flow_style=False, **options):
    """Return msg as YAML text; the options are those of plain_value."""
    return yaml.dump(
        plain_value(msg, **options),
        Dumper=_Dumper,
        allow_unicode=True,
        width=sys.maxsize,
        default_flow_style=flow_style,
        sort_keys=False,
    )


def message_to_csv(msg, **options):
    """Return all numbers and strings of msg, separated by commas; the options are those of plain_value."""
    return _csv(plain_value(msg, **options))


def _csv(value):
    if isinstance(value, (dict, list)):
        return ','.join(map(_csv, value.values() if isinstance(value, dict) else value))
    return str(value)


def plain_value(value, truncate_length=None, no_arr=False, no_str=False, slot_type=None):
    """
    Return a message or the value of a field as dictionaries, lists, numbers and strings.

    Arrays, strings and bytes longer than truncate_length end in '...'; no_arr and no_str name type and length of an
    array or string instead of its content. slot_type is the type of a field, None within an array.
    """
    options = dict(truncate_length=truncate_length, no_arr=no_arr, no_str=no_str)
    if hasattr(value, 'SLOT_TYPES'):
        return {
            name: plain_value(getattr(value, name), slot_type=slot_type, **options)
            for name, slot_type in zip(value.get_fields_and_field_types(), value.SLOT_TYPES, strict=True)
        }
    if no_str and isinstance(value, str):
        return f'<string length: <{len(value)}>>'
    if isinstance(value, (str, bytes)):
        kept = value[:truncate_length]
        return kept if len(kept) == len(value) else kept + ('...' if isinstance(value, str) else b'...')
    if isinstance(value, (list, array.array, np.ndarray)):
        if no_arr and slot_type is not None:
            return _array_summary(slot_type, len(value))
        kept = [plain_value(item, **options) for item in value[:truncate_length]]
        return kept if len(kept) == len(value) else [*kept, '...']
    return value.item() if isinstance(value, np.number) else value


def _array_summary(slot_type, length):
    item = slot_type.value_type
    if isinstance(item, NamespacedType):
        name = '/'.join(item.namespaced_name())
    else:
        name = getattr(item, 'typename', 'wstring' if isinstance(item, AbstractWString) else 'string')
    if isinstance(slot_type, Array):
        return f'<array type: {name}[{slot_type.size}]>'
    bound = f'[{slot_type.maximum_size}]' if isinstance(slot_type, BoundedSequence) else ''
    return f'<sequence type: {name}{bound}, length: {length}>'


def make_message(message_class, values, stamps=None):
    """
    Return a message with the fields of the dictionary `values`; a value of another type raises.

    With the list `stamps`, the text `auto` for a header and `now` for a time are accepted, as in `ros2 topic pub`, and
    the times to set are appended to it.
    """
    if not isinstance(values, dict):
        raise TypeError(f"Value '{values}' is expected to be a dictionary but is a {type(values).__name__}")
    msg = message_class(check_fields=True)
    slot_types = dict(zip(msg.get_fields_and_field_types(), msg.SLOT_TYPES, strict=True))
    for name, value in values.items():
        setattr(msg, name, _field_value(getattr(msg, name), value, slot_types[name], stamps))
    return msg


def _field_value(default, value, slot_type, stamps):
    """Return `value` in the type of a field whose default is `default`."""
    if hasattr(default, 'SLOT_TYPES'):
        word = {Header: 'auto', Time: 'now'}.get(type(default))
        if stamps is not None and value == word:
            stamps.append(default.stamp if word == 'auto' else default)
            return default
        return make_message(type(default), value, stamps)
    if isinstance(default, array.array):
        return array.array(default.typecode, value)
    if isinstance(default, np.ndarray):
        return np.array(value, dtype=default.dtype)
    if isinstance(slot_type, AbstractNestedType) and isinstance(slot_type.value_type, NamespacedType):
        item_class = find_interface('/'.join(slot_type.value_type.namespaced_name()), 'msg')
        return [make_message(item_class, item, stamps) for item in value]
    return value if type(value) is type(default) else type(default)(value)
