"""
Messages of which only stamps and some numbers change, as bytes.

rclpy makes a message object, and bytes of it, field by field: 15 us for a pose, 500 us for the markers of a machine.
Where strings and lengths stay, the numbers can be put into the bytes of the last message instead, in 5 us. Nothing is
different on the topics.
"""

from array import array

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion

from pkm_core.bag.message_types import typestore

# what stands in a message that becomes a template for a double, a stamp and a pose that change
DOUBLE = float('nan')
STAMP = Time(sec=-(2**31), nanosec=2**32 - 1)
POSE = Pose(
    position=Point(x=DOUBLE, y=DOUBLE, z=DOUBLE), orientation=Quaternion(x=DOUBLE, y=DOUBLE, z=DOUBLE, w=DOUBLE)
)
_HEADER = 4  # [bytes] what follows is aligned as if it began there
_SECOND = 1_000_000_000  # ns


class Template:
    """
    A message with gaps.

    Parameters
    ----------
    message
        Any message of ROS; its gaps are the doubles that are `DOUBLE` and the stamps that are `STAMP`.

    """

    def __init__(self, message):
        data = _serialized(message)
        self._bytes = np.frombuffer(data, np.uint8).copy()
        doubles, words = (
            np.frombuffer(self._bytes, kind, (len(data) - _HEADER) // size, _HEADER)
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
            One a double that changes, in the order of the message's definition.
        nanoseconds : int
            All stamps [ns].

        """
        self._doubles[self._double_gaps] = numbers
        self._words[self._stamp_gaps] = nanoseconds // _SECOND
        self._words[self._stamp_gaps + 1] = nanoseconds % _SECOND
        return self._bytes.tobytes()


def _serialized(message):
    """Return `message` as bytes; rclpy would leave anything between the numbers, and more behind the last one."""
    return bytes(typestore().serialize_cdr(_plain(message), _kind(message)))


def _plain(value):
    """Return a message of rclpy, or what stands in one, as the types of pkm_core.bag.message_types."""
    if isinstance(value, (array, np.ndarray)):
        return np.array(value)
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    if not hasattr(value, 'get_fields_and_field_types'):
        return value
    fields = {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    return typestore().types[_kind(value)](**fields)


def _kind(message):
    """Return the name of the type of `message`."""
    return f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'
