"""Places of numbers in serialized messages, against the serializer of rosbags."""

import struct

import numpy as np
import pytest

from pkm_core.bag.layout import HEADER, Place, layout_of
from pkm_core.bag.message_types import typestore

TYPES = typestore().types
STAMP = TYPES['builtin_interfaces/msg/Time'](sec=-7, nanosec=999_999_999)
HEADED = TYPES['std_msgs/msg/Header'](stamp=STAMP, frame_id='base')
ENCODER = 'pkm_interfaces/msg/EncoderSample'
MARKERS = 'visualization_msgs/msg/MarkerArray'


def serialized(kind, **fields):
    return bytes(typestore().serialize_cdr(TYPES[kind](**fields), kind))


def value_at(data, place):
    return np.frombuffer(data, place.kind, 1, place.offset)[0]


def test_numbers_of_a_fixed_message_are_at_their_places():
    fields = {'tick': 2**40, 'cycle': 7, 'index': 679, 'mode': 1, 'counts': -(2**33), 'position': -0.01}
    layout = layout_of(ENCODER)
    data = serialized(ENCODER, **fields)
    assert {path: value_at(data, place) for path, place in layout.places.items()} == fields
    assert layout.is_fixed
    assert struct.unpack(f'<4x{layout.format}', data) == tuple(fields.values())
    assert data.startswith(HEADER)


def test_stamp_of_a_nested_header_is_at_its_place():
    data = serialized(
        'sensor_msgs/msg/JointState',
        header=HEADED,
        **dict.fromkeys(('position', 'velocity', 'effort'), np.zeros(1)),
        name=['d1'],
    )
    layout = layout_of('sensor_msgs/msg/JointState')
    assert [value_at(data, layout.places[f'header.stamp.{part}']) for part in ('sec', 'nanosec')] == [-7, 999_999_999]
    assert list(layout.places) == ['header.stamp.sec', 'header.stamp.nanosec'], 'a string follows'
    assert not layout.is_fixed


def test_first_element_of_a_sequence_has_places():
    layout = layout_of(MARKERS)
    assert layout.places['markers.length'] == Place(4, '<u4')
    assert layout.places['markers.0.header.stamp.sec'] == Place(8, '<i4')


def test_arrays_have_a_place_per_element():
    places = layout_of('geometry_msgs/msg/PoseWithCovariance').places
    assert places['covariance.35'] == Place(4 + 7 * 8 + 35 * 8, '<f8')


def test_unknown_type_is_refused():
    with pytest.raises(KeyError):
        layout_of('pkm_interfaces/msg/Nothing')
