"""Serialized messages of one topic that arrived together."""

from typing import NamedTuple

import numpy as np

# tick of a single message that arrived before the first tick of its cycle
BEFORE = -1


class Block(NamedTuple):
    """Messages of equal size, oldest first."""

    topic: str
    messages: np.ndarray  # (n, size) of bytes
    ticks: np.ndarray  # (n,) int64; BEFORE the first tick of the cycle

    def where(self, mask):
        """Return the messages for which `mask` (n,) is true."""
        return self if mask.all() else self._replace(messages=self.messages[mask], ticks=self.ticks[mask])


def single(topic, message, tick):
    """Return the `Block` of one message (size,); `tick` may be None before the first tick of its cycle."""
    return Block(topic, message[np.newaxis], np.array([BEFORE if tick is None else tick]))


def rows(data, size=None):
    """Return `data`, one message, several of `size` bytes in a row or their (n, size) array, as such an array."""
    if isinstance(data, np.ndarray):
        return data
    if not data:
        return np.zeros((1, 0) if size is None else (0, size), np.uint8)
    return np.frombuffer(data, np.uint8).reshape(-1, size or len(data))


def numbers_at(messages, place):
    """Return the numbers (n,) at a `Place` of `messages` (n, size)."""
    return np.ndarray(len(messages), place.kind, messages, place.offset, messages.shape[1:])
