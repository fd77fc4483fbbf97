"""Error and voltage of every axis over one cycle, read from its bag."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader

from pkm_core.bag.reader import bag_files
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
    try:
        for file in bag_files(path):
            with file.open('rb') as stream:
                for _, channel, message in make_reader(stream).iter_messages(topics=list(taken), log_time_order=False):
                    taken[channel.topic].append(message.data)
        columns = [np.frombuffer(b''.join(messages), _COMMAND) for messages in taken.values()]
    except (OSError, McapError, ValueError) as error:
        raise BagError(f'{path}: cannot be read as a bag of this cell: {error}') from None
    length = min(map(len, columns))
    if length == 0 or any(not np.array_equal(each['tick'][:length], columns[0]['tick'][:length]) for each in columns):
        raise BagError(f'{path}: has no tick with a command of every joint of {list(joints)}')
    error, voltage = (np.stack([each[name][:length] for each in columns], axis=1) for name in ('error', 'voltage'))
    return Trace(cycle, error, voltage)
