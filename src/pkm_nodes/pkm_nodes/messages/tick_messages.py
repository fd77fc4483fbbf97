"""
The messages of the servo tick as bytes.

rclpy converts between message objects and bytes field by field, 2 us for each message, and a cell handles twenty of
them per tick. They are numbers only, so one `struct` format packs and unpacks them at a tenth of the cost. The topics
carry the same messages: an ordinary subscription gets message objects.
"""

from functools import partial
from struct import Struct

from pkm_core.bag.layout import HEADER, layout_of


class TickMessage:
    """
    Packs and unpacks the messages of one type, which consists of numbers only.

    Attributes
    ----------
    pack : callable
        Returns the serialized message of these fields, in the order of the definition.
    unpack : callable
        Returns the fields of a serialized message as a tuple.
    size : int
        [bytes] of a serialized message.

    """

    def __init__(self, kind):
        numbers = layout_of(kind).format
        self.pack = partial(Struct(f'<{len(HEADER)}s{numbers}').pack, HEADER)
        fields = Struct(f'<{len(HEADER)}x{numbers}')
        self.unpack, self.size = fields.unpack, fields.size


ENCODER_SAMPLE = TickMessage('pkm_interfaces/msg/EncoderSample')
MOTOR_COMMAND = TickMessage('pkm_interfaces/msg/MotorCommand')
UINT64 = TickMessage('std_msgs/msg/UInt64')
