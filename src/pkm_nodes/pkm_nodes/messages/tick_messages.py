"""
The messages of the servo tick as bytes.

rclpy makes a message object of the bytes that come in, and bytes of the object that goes out, field by field through C:
2 us for each, and a cell deals in twenty of them every tick. They are numbers only, so one `struct` format describes
their bytes (CDR, little-endian, every number aligned to its own size), at a tenth of the cost. Nothing is different on
the topics: who subscribes in the ordinary way gets message objects.
"""

from functools import partial
from struct import Struct, calcsize

from pkm_interfaces.msg import EncoderSample, MotorCommand

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'  # the header of every serialized message
_LETTERS = {
    **{'int8': 'b', 'int16': 'h', 'int32': 'i', 'int64': 'q', 'float': 'f', 'boolean': '?'},
    **{'uint8': 'B', 'uint16': 'H', 'uint32': 'I', 'uint64': 'Q', 'double': 'd'},
}


class Layout:
    """
    Where the fields of a message of numbers stand in its bytes.

    Attributes
    ----------
    pack : callable
        The bytes of a message with these fields, in the order of its definition.
    unpack : callable
        The tuple of the fields of a message in bytes.

    """

    def __init__(self, message_type):
        fields, end = '', 0
        for kind in message_type.get_fields_and_field_types().values():
            size = calcsize(f'={_LETTERS[kind]}')
            gap = -end % size
            fields += f'{gap}x{_LETTERS[kind]}'
            end += gap + size
        self.pack = partial(Struct(f'<4s{fields}').pack, _LITTLE_ENDIAN)
        self.unpack = Struct(f'<4x{fields}').unpack


ENCODER_SAMPLE = Layout(EncoderSample)
MOTOR_COMMAND = Layout(MotorCommand)
