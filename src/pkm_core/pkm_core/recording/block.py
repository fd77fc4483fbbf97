"""Serialized messages of one topic that came together."""

from typing import NamedTuple

import numpy as np


class Block(NamedTuple):
    """Messages of equal size, oldest first."""

    topic: str
    messages: np.ndarray  # (n, size) of bytes
    ticks: np.ndarray | None  # (n,) that they belong to; None for before the first of their cycle

    def where(self, mask):
        """Return those of which `mask` (n,) is true."""
        return self if mask.all() else self._replace(messages=self.messages[mask], ticks=self.ticks[mask])


def single(topic, message, tick):
    """Return the `Block` of one message (size,); `tick` is None before the first one."""
    return Block(topic, message[np.newaxis], None if tick is None else np.array([tick]))


def rows(data, size=None):
    """Return messages as the rows of an array: bytes of one, or of several of `size` one after the other, or rows."""
    if isinstance(data, np.ndarray):
        return data
    return np.frombuffer(data, np.uint8).reshape(-1, size or len(data))


def numbers_at(messages, offset, kind):
    """Return the numbers of the numpy type `kind` that stand `offset` bytes from the start of every row."""
    return np.ndarray(len(messages), kind, messages, offset, messages.shape[1:])
