"""
Messages of which only stamps and some numbers change, as bytes.

rclpy makes a message object and serializes it field by field: 15 us for a pose, 500 us for the markers of a machine.
Where strings and lengths are constant, the numbers are written into the bytes of the previous message instead, in
5 us. The topics carry the same messages.
"""

from array import array

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion

from pkm_core.bag.layout import HEADER
from pkm_core.bag.message_types import typestore

# placeholders in the message that becomes a template: a double, a stamp and a pose that change
DOUBLE = float('nan')
STAMP = Time(sec=-(2**31), nanosec=2**32 - 1)
POSE = Pose(
    position=Point(x=DOUBLE, y=DOUBLE, z=DOUBLE), orientation=Quaternion(x=DOUBLE, y=DOUBLE, z=DOUBLE, w=DOUBLE)
)
_SECOND = 1_000_000_000  # ns


class Template:
    """
    A serialized message with gaps.

    Parameters
    ----------
    message
        Any ROS message; its gaps are the doubles equal to `DOUBLE`, bit by bit, and the stamps equal to `STAMP`.

    """

    def __init__(self, message):
        data = _serialized(message)
        self._bytes = np.frombuffer(data, np.uint8).copy()
        doubles, words = (  # both aligned to the end of the header
            np.frombuffer(self._bytes, kind, (len(data) - len(HEADER)) // size, len(HEADER))
            for kind, size in (('<u8', 8), ('<u4', 4))
        )
        self._doubles, self._words = doubles.view('<f8'), words
        self._double_gaps = np.flatnonzero(doubles == np.array(DOUBLE).view('<u8'))
        self._stamp_gaps = np.flatnonzero((words[:-1] == STAMP.sec % 2**32) & (words[1:] == STAMP.nanosec))

    def filled(self, numbers, nanoseconds=0):
        """
        Return the bytes of the message.

        Parameters
        ----------
        numbers : sequence of float
            One per gap of a double, in the order of the message's definition.
        nanoseconds : int
            Value of every stamp [ns].

        Raises
        ------
        ValueError
            If the count of `numbers` differs from the count of gaps.

        """
        self._doubles[self._double_gaps] = numbers
        self._words[self._stamp_gaps] = nanoseconds // _SECOND
        self._words[self._stamp_gaps + 1] = nanoseconds % _SECOND
        return self._bytes.tobytes()


def _serialized(message):
    """Return the bytes of `message`; rclpy's serializer leaves padding undefined and appends bytes at the end."""
    return bytes(typestore().serialize_cdr(_plain(message), _kind(message)))


def _plain(value):
    """Return a message of rclpy, or a field of one, as the types of pkm_core.bag.message_types."""
    if isinstance(value, (array, np.ndarray)):
        return np.array(value)
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    if not hasattr(value, 'get_fields_and_field_types'):
        return value
    fields = {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    return typestore().types[_kind(value)](**fields)


def _kind(message):
    """Return the name of the type of `message`, 'package/msg/Name'."""
    return f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'
