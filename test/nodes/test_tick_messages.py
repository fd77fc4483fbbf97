"""The bytes of the servo tick, against the serializer of ROS."""

from math import pi

import pytest
from rclpy.serialization import deserialize_message, serialize_message

from pkm_interfaces.msg import EncoderSample, MotorCommand
from pkm_nodes.messages.tick_messages import ENCODER_SAMPLE, MOTOR_COMMAND

SAMPLE = {'tick': 2**40 + 1, 'cycle': 7, 'index': 679, 'mode': 1, 'counts': -(2**33), 'position': -pi / 100}
COMMAND = {'tick': 2**63, 'cycle': 2**32 - 1, 'voltage': -9.99, 'error': 1.5e-7, 'feedforward': float('inf')}
CASES = [(ENCODER_SAMPLE, EncoderSample, SAMPLE), (MOTOR_COMMAND, MotorCommand, COMMAND)]


@pytest.mark.parametrize(('message', 'message_type', 'fields'), CASES)
def test_packed_bytes_are_read_by_ros(message, message_type, fields):
    assert list(fields) == list(message_type.get_fields_and_field_types())
    assert deserialize_message(message.pack(*fields.values()), message_type) == message_type(**fields)


@pytest.mark.parametrize(('message', 'message_type', 'fields'), CASES)
def test_bytes_of_ros_are_unpacked_to_plain_numbers(message, message_type, fields):
    values = message.unpack(serialize_message(message_type(**fields)))
    assert values == tuple(fields.values())
    assert {type(value) for value in values} == {int, float}
