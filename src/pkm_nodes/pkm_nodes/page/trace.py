"""Error and voltage of every axis, and the samples of the laser, over one cycle, read from its bag."""

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


# a serialized LaserSample: CDR header, time, number of coordinates, their displacements
_LASER_HEAD, _LASER_DISPLACEMENT = 4, 20  # [bytes]


@dataclass(frozen=True, eq=False)
class Trace:
    """One cycle; one row per tick, one column per joint."""

    cycle: int
    error: np.ndarray  # (N, n) [m]
    voltage: np.ndarray  # (N, n) [V]
    first_tick: int
    laser_time: np.ndarray  # (K,) since tick 0 [s]; empty without a laser
    laser: np.ndarray  # (K, m) displacement [m, rad]


def read_trace(path, cycle, joints, namespace):
    """Return the `Trace` of `cycle` in the bag folder `path`; `BagError` if it cannot be read."""
    laser = f'{namespace}/laser'
    if not Path(path).exists():
        raise BagError(f'{path}: no such bag on this computer')
    command = {f'{namespace}/{joint}/command': [] for joint in joints}
    taken = {**command, laser: []}
    for topic, _, data, _ in raw_messages(path, taken):
        if topic in command and len(data) != _COMMAND.itemsize:
            raise BagError(f'{path}: {topic}: a command has {len(data)} bytes; expected {_COMMAND.itemsize}')
        taken[topic].append(data)
    samples = _laser_samples(f'{path}: {laser}', taken.pop(laser))
    columns = [np.frombuffer(b''.join(messages), _COMMAND) for messages in taken.values()]
    length = min(map(len, columns))
    if length == 0 or any(not np.array_equal(each['tick'][:length], columns[0]['tick'][:length]) for each in columns):
        raise BagError(f'{path}: has no tick with a command of every joint of {list(joints)}')
    error, voltage = (np.stack([each[name][:length] for each in columns], axis=1) for name in ('error', 'voltage'))
    return Trace(cycle, error, voltage, int(columns[0]['tick'][0]), *samples)


def _laser_samples(where, messages):
    """Return time (K,) and displacement (K, m) of serialized samples; `BagError` if their sizes are not those."""
    if not messages:
        return np.zeros(0), np.zeros((0, 0))
    sizes = {len(data) for data in messages}
    size = sizes.pop()
    if sizes or size < _LASER_DISPLACEMENT or (size - _LASER_DISPLACEMENT) % 8:
        raise BagError(f'{where}: samples of {sorted({size, *sizes})} bytes; expected one size')
    rows = np.frombuffer(b''.join(messages), np.uint8).reshape(-1, size)
    parts = (rows[:, _LASER_HEAD : _LASER_HEAD + 8], rows[:, _LASER_DISPLACEMENT:])
    time, displacement = (np.ascontiguousarray(part).view('<f8') for part in parts)
    return time[:, 0], displacement
