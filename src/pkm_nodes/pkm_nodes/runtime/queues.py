"""
Takes the messages in the queues of subscriptions, many at a time.

rclpy makes Python objects of every message and of its metadata, 1.2 us per message. A recorder gets eight messages per
tick and needs only their bytes. Here the loop over `rcl_take_serialized_message`, the function that rclpy calls for raw
messages, is compiled: 0.3 us per message. The structures of rcl and rcutils are not public: fast_path.py checks them.
"""

import ctypes
from functools import partial

import numpy as np
from numba import njit, types
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from pkm_nodes.runtime.denials import KIND, LAST_KIND, NONE

# rclpy has loaded both, so no path is needed; compiled code finds global symbols only
ctypes.CDLL('librcl.so', ctypes.RTLD_GLOBAL)
_rcutils = ctypes.CDLL('librcutils.so')
take_serialized = types.ExternalFunction('rcl_take_serialized_message', types.int32(*4 * [types.intp]))
copy = types.ExternalFunction('memcpy', types.intp(*3 * [types.intp]))

# of rcl/types.h
OK, NOTHING = 0, 401  # RCL_RET_OK, RCL_RET_SUBSCRIPTION_TAKE_FAILED
# rcutils_uint8_array_t as eight words: buffer, length, capacity and five of its allocator
_BUFFER, LENGTH, ALLOCATOR, MESSAGE_WORDS = 0, 1, 3, 8
# rmw_message_info_t as eight words: four of times and numbers, name of the middleware, GID of the publisher in two
GID, INFO_WORDS = 5, 8
# [bytes] room for one block of messages: a thousand of the servo tick
_ROOM = 64 * 1024
# most messages of one block
_MOST = 1500


class _Allocator(ctypes.Structure):  # rcutils_allocator_t
    _fields_ = [(name, ctypes.c_void_p) for name in ('allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')]


_rcutils.rcutils_get_default_allocator.restype = _Allocator
fini = _rcutils.rcutils_uint8_array_fini


def default_allocator():
    """Return rcutils' allocator as words."""
    return np.frombuffer(_rcutils.rcutils_get_default_allocator(), np.int64)


def raise_error(what):
    """Raise the `RCLError` of a take that returned `what`."""
    raise _rclpy.RCLError(f'rcl_take_serialized_message: returned {what}; expected {OK} or {NOTHING}')


@njit('boolean(int64[::1], int64[::1], int64[::1], int64[:, ::1])', cache=True)
def _is_denied(message, info, unused, denied):
    """Return whether the message just taken is one of `Denials`, and count it."""
    if message[LENGTH] < KIND + 1:
        return False
    first = np.zeros(1, np.int64)
    copy(first.ctypes.data, message[_BUFFER], KIND + 1)
    kind = 1 << min(first[0] >> 8 * KIND, LAST_KIND)
    if unused[0] & kind:
        return True
    for row in range(len(denied)):
        if denied[row, 2] & kind and denied[row, 0] == info[GID] and denied[row, 1] == info[GID + 1]:
            denied[row, 3] += 1
            return True
    return False


@njit(
    'UniTuple(int64, 3)(int64, int64[::1], int64[::1], uint8[::1], int64[:, ::1], int64, int64[::1], int64[:, ::1])',
    cache=True,
)
def _take_alike(subscription, message, info, content, senders, most, unused, denied):
    """
    Copy up to `most` messages of equal size from the queue of `subscription` to `content`, their GIDs to `senders`.

    The first message of another size, or without room, stays in `message` for the next call. Messages of `Denials` are
    dropped, and count to `most`.

    Returns
    -------
    number, end : int
        Number of the messages in `content`, and their end in it [bytes].
    code : int
        Return code of rcl: `OK`, `NOTHING` when the queue is empty, or an error.

    """
    number, end, dropped = 0, 0, 0
    size = message[LENGTH]
    while number + dropped < most and number < len(senders):
        if not message[LENGTH]:
            code = take_serialized(subscription, message.ctypes.data, info.ctypes.data, 0)
            if code != OK:
                message[LENGTH] = 0
                return number, end, code
            if _is_denied(message, info, unused, denied):
                message[LENGTH] = 0
                dropped += 1
                continue
            size = size or message[LENGTH]
        if message[LENGTH] != size or end + size > len(content):
            break
        copy(content.ctypes.data + end, message[_BUFFER], size)
        message[LENGTH] = 0
        senders[number] = info[GID : GID + 2]
        number, end = number + 1, end + size
    return number, end, OK


class Taker:
    """Takes the messages of raw subscriptions, one subscription per call."""

    def __init__(self):
        self._content = np.empty(_ROOM, np.uint8)
        self._senders = np.empty((_MOST, 2), np.int64)
        self._message = np.zeros(MESSAGE_WORDS, np.int64)
        self._message[ALLOCATOR:] = default_allocator()
        self._info = np.zeros(INFO_WORDS, np.int64)  # of `_message`

        self._end = partial(fini, ctypes.c_void_p(self._message.ctypes.data))  # numpy may be gone at the very end

    def __del__(self):
        self._end()

    def take(self, subscription, callback, enough, denials=NONE):
        """
        Call `callback` with the waiting messages, oldest first, until none is left or `enough` were taken.

        Parameters
        ----------
        subscription : int
            Address of its rcl_subscription_t; the caller keeps it alive.
        callback : callable
            ``callback(messages, senders)``: messages of equal size, the rows of an array of bytes, and the GID of the
            publisher of each, the rows (n, 2) of an array of int64.
        enough : int
            Number of messages after which the others stay in the queue.
        denials : Denials, optional
            Messages that are dropped.

        Returns
        -------
        taken : int
            Number of messages.

        Raises
        ------
        RCLError
            If rcl returns an error.

        """
        taken, code = 0, OK
        while code == OK and (taken < enough or self._message[LENGTH]):
            held = self._message, self._info, self._content, self._senders
            number, end, code = _take_alike(subscription, *held, enough, denials.unused, denials.rows)
            if number:
                callback(self._content[:end].reshape(number, -1).copy(), self._senders[:number].copy())
            elif code == OK and not self._message[LENGTH]:
                break  # enough were dropped
            elif code == OK:
                callback(self._take_large(), self._info[np.newaxis, GID : GID + 2].copy())
                number = 1
            taken += number
        if code not in (OK, NOTHING):
            raise_error(code)
        return taken

    def _take_large(self):
        """Return the message in `_message`, which is larger than the room for a block."""
        data = ctypes.string_at(int(self._message[_BUFFER]), int(self._message[LENGTH]))
        self._message[LENGTH] = 0
        return np.frombuffer(data, np.uint8)[np.newaxis]
