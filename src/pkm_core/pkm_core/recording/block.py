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


def rows(data, number=1):
    """Return the bytes of `number` messages of equal size, one after the other, as the rows of an array."""
    return np.frombuffer(data, np.uint8).reshape(number, -1)


def field(messages, offset, kind):
    """Return the numbers of the numpy type `kind` that stand `offset` bytes from the start of every row."""
    size = np.dtype(kind).itemsize
    return np.ascontiguousarray(messages[:, offset : offset + size]).view(kind)[:, 0]
