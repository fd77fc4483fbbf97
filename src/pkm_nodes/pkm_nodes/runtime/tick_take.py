"""
Takes one message of the servo tick and compares its size, byte order and sender, all compiled.

rclpy's take makes Python objects of the message and its metadata, 1.9 us, and does not return the GID of the publisher.
This one takes 1.0 us. The structures of rcl and rmw are not public: fast_path.py checks them.
"""

import ctypes
from functools import partial

import numpy as np
from numba import njit

from pkm_nodes.runtime.queues import (
    ALLOCATOR,
    GID,
    INFO_WORDS,
    LENGTH,
    MESSAGE_WORDS,
    NOTHING,
    OK,
    copy,
    default_allocator,
    fini,
    raise_error,
    take_serialized,
)

# int64 words of a record: address of the subscription, rcutils_uint8_array_t, rmw_message_info_t, GID of the sender
# that is expected, size that is expected [bytes], content
_MESSAGE = 1
_INFO = _MESSAGE + MESSAGE_WORDS
_EXPECTED = _INFO + INFO_WORDS
_SIZE = _EXPECTED + 2
_CONTENT = _SIZE + 1
_SENDER = _INFO + GID
_WORD = 8  # bytes
# first word of a message in plain CDR, little-endian: bytes 0 1 0 0
_LITTLE_ENDIAN = 0x100

# results of `take_one` that are no size
EMPTY, MALFORMED, STRANGER, FAILED = 0, -1, -2, -3


@njit('int64(int64[::1])', cache=True)
def take_one(record):
    """
    Take a message into `record`; return its size [bytes] if size, byte order and sender are the expected ones.

    Otherwise return `EMPTY` without a message, `MALFORMED`, `STRANGER` for a well-formed message of another sender, or
    `FAILED` after an error of rcl.
    """
    start = record.ctypes.data
    code = take_serialized(record[0], start + _WORD * _MESSAGE, start + _WORD * _INFO, 0)
    if code == NOTHING:
        return EMPTY
    if code != OK:
        return FAILED
    size = record[_SIZE]
    if record[_MESSAGE + LENGTH] != size:
        return MALFORMED
    copy(start + _WORD * _CONTENT, record[_MESSAGE], size)
    if record[_CONTENT] & 0xFFFFFFFF != _LITTLE_ENDIAN:
        return MALFORMED
    if record[_SENDER] != record[_EXPECTED] or record[_SENDER + 1] != record[_EXPECTED + 1]:
        return STRANGER
    return size


class TickTake:
    """
    Takes the messages of one subscription.

    Parameters
    ----------
    pointer : int
        Address of its rcl_subscription_t; the caller keeps it alive.
    size : int
        Expected size of a serialized message [bytes].

    Attributes
    ----------
    record : ndarray of int64
        Argument of `take_one`.
    content : memoryview
        The message after `take_one`; after `MALFORMED` see `malformed`.

    """

    def __init__(self, pointer, size):
        self.record = np.zeros(_CONTENT + -(-size // _WORD), np.int64)
        self.record[0], self.record[_SIZE] = pointer, size
        self.record[_MESSAGE + ALLOCATOR : _INFO] = default_allocator()
        self._bytes = memoryview(self.record.view(np.uint8))
        self.content = self._bytes[_WORD * _CONTENT :][:size]

        self._end = partial(fini, ctypes.c_void_p(self.record.ctypes.data + _WORD * _MESSAGE))  # see queues.py

    def __del__(self):
        self._end()

    def expect(self, gid):
        """Take messages of the publisher with this GID only; with b'' every sender is a stranger."""
        self.record[_EXPECTED:_SIZE] = np.frombuffer(gid.ljust(2 * _WORD, b'\0'), np.int64)

    @property
    def sender(self):
        """GID of the publisher of the last message."""
        return self._bytes[_WORD * _SENDER :][: 2 * _WORD].tobytes()

    @property
    def malformed(self):
        """The last message, whatever its size."""
        return ctypes.string_at(int(self.record[_MESSAGE]), int(self.record[_MESSAGE + LENGTH]))

    def raise_error(self):
        """Raise the `RCLError` of a take that has `FAILED`."""
        raise_error('an error')
