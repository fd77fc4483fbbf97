"""Error and voltage of every axis over one cycle, read from its bag."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.bag.reader import raw_messages
from pkm_core.errors import BagError

# A serialized MotorCommand: CDR header, then the fields of the message, each aligned to its size. Read as one array:
# parsing message by message takes 0.15 s per cycle, and that from the processor of the cell.
_COMMAND = np.dtype(
    {
        'names': ['tick', 'voltage', 'error'],
        'formats': ['<u8', '<f8', '<f8'],
        'offsets': [4, 20, 28],
        'itemsize': 44,
    }
)


@dataclass(frozen=True, eq=False)
class Trace:
    """One cycle; one row per tick, one column per joint."""

    cycle: int
    error: np.ndarray  # (N, n) [m]
    voltage: np.ndarray  # (N, n) [V]


def read_trace(path, cycle, joints, namespace):
    """Return the `Trace` of `cycle` in the bag folder `path`; `BagError` if it cannot be read."""
    if not Path(path).exists():
        raise BagError(f'{path}: no such bag on this computer')
    taken = {f'{namespace}/{joint}/command': [] for joint in joints}
    for topic, _, data, _ in raw_messages(path, taken):
        if len(data) != _COMMAND.itemsize:
            raise BagError(f'{path}: {topic}: a command has {len(data)} bytes; expected {_COMMAND.itemsize}')
        taken[topic].append(data)
    columns = [np.frombuffer(b''.join(messages), _COMMAND) for messages in taken.values()]
    length = min(map(len, columns))
    if length == 0 or any(not np.array_equal(each['tick'][:length], columns[0]['tick'][:length]) for each in columns):
        raise BagError(f'{path}: has no tick with a command of every joint of {list(joints)}')
    error, voltage = (np.stack([each[name][:length] for each in columns], axis=1) for name in ('error', 'voltage'))
    return Trace(cycle, error, voltage)
