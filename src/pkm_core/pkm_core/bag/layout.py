"""
The places of the numbers in a serialized message.

A serialized message is CDR, little-endian: a header of 4 bytes, then the fields in the order of the definition. Every
number is aligned to its own size, counted from the end of the header. Places are fixed up to the first string or
sequence; the leading numbers of the first element of a sequence have a fixed place too.
Source: OMG, DDS-XTypes 1.3, section 7.4.1 (plain CDR, version 1).
"""

from functools import cache
from struct import calcsize
from typing import NamedTuple

from rosbags.interfaces import Nodetype

from pkm_core.bag.message_types import typestore

HEADER = b'\x00\x01\x00\x00'  # plain CDR, little-endian
# letter of `struct` by number type
_LETTERS = {
    **{'int8': 'b', 'int16': 'h', 'int32': 'i', 'int64': 'q', 'float32': 'f', 'bool': '?'},
    **{'uint8': 'B', 'uint16': 'H', 'uint32': 'I', 'uint64': 'Q', 'float64': 'd', 'octet': 'B'},
}


class Place(NamedTuple):
    """Place of one number in a serialized message."""

    offset: int  # [bytes] from the start of the message
    kind: str  # of numpy, '<u8' for uint64


class Layout(NamedTuple):
    """
    Layout of the serialized messages of one type.

    Attributes
    ----------
    places : dict of str to Place
        By path: 'tick', 'header.stamp.sec', 'markers.0.header.stamp.sec'; 'markers.length' is the length of a sequence.
    format : str
        The same numbers as a format of `struct`, without header and byte order.
    is_fixed : bool
        Whether these numbers are the whole message.
    size : int
        [bytes] from the start of the message to the end of the last of these numbers.

    """

    places: dict[str, Place]
    format: str
    is_fixed: bool
    size: int


@cache
def layout_of(kind):
    """
    Return the `Layout` of the message type `kind`, e.g. 'pkm_interfaces/msg/EncoderSample'.

    Raises
    ------
    KeyError
        If the type is not defined.

    Examples
    --------
    >>> layout_of('sensor_msgs/msg/JointState').places['header.stamp.nanosec']
    Place(offset=8, kind='<u4')

    """
    numbers: list[tuple[str, str]] = []
    is_fixed = _append_fields(numbers, kind, '')
    places, formats, end = {}, '', 0
    for path, letter in numbers:
        size = calcsize(f'={letter}')
        gap = -end % size
        places[path] = Place(len(HEADER) + end + gap, f'<{_numpy_kind(letter, size)}')
        formats += f'{gap}x{letter}'
        end += gap + size
    return Layout(places, formats, is_fixed, len(HEADER) + end)


def _append_fields(numbers, kind, prefix):
    """Append (path, letter) of every number of `kind` with a fixed place; return whether they are all there is."""
    return all(_append(numbers, field, f'{prefix}{name}') for name, field in typestore().fielddefs[kind][1])


def _append(numbers, field, path):
    node, detail = field
    if node is Nodetype.NAME:
        return _append_fields(numbers, detail, f'{path}.')
    if node is Nodetype.ARRAY:
        element, length = detail
        return all(_append(numbers, element, f'{path}.{index}') for index in range(length))
    if node is Nodetype.SEQUENCE:
        numbers.append((f'{path}.length', _LETTERS['uint32']))
        _append(numbers, detail[0], f'{path}.0')
        return False
    letter = _LETTERS.get(detail[0])  # none for a string
    if letter is not None:
        numbers.append((path, letter))
    return letter is not None


def _numpy_kind(letter, size):
    return f'{"f" if letter in "fd" else "u" if letter in "BHIQ" else "b" if letter == "?" else "i"}{size}'
