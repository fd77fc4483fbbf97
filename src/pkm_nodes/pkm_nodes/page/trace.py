"""One cycle as curves, read from its bag: errors, voltages, learned voltages, and the samples of the laser."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.bag.pieces import extensions, planned
from pkm_core.bag.reader import damage_refused, raw_messages, read_topics
from pkm_core.errors import BagError
from pkm_nodes.page.tool_trace import ToolTrace, tool_trace

# A serialized MotorCommand: CDR header, then the fields of the message, each aligned to its size. Read as one array:
# parsing message by message takes 0.15 s per cycle, and that from the processor of the cell.
_COMMAND = np.dtype(
    {
        'names': ['tick', 'voltage', 'error', 'feedforward'],
        'formats': ['<u8', '<f8', '<f8', '<f8'],
        'offsets': [4, 20, 28, 36],
        'itemsize': 44,
    }
)


# a serialized LaserSample: CDR header, time, number of coordinates, their displacements
_LASER_HEAD, _LASER_DISPLACEMENT = 4, 20  # [bytes]


@dataclass(frozen=True, eq=False)
class Trace:
    """One cycle; one row per tick that every joint answered, one column per joint. All of it is from one bag."""

    cycle: int
    motion: str
    law: str
    samples: int  # ticks of the whole cycle; there are fewer rows after a safe stop; 0 if they are unknown
    error: np.ndarray  # (N, n) [m]
    voltage: np.ndarray  # (N, n) [V]
    feedforward: np.ndarray  # (N, n) [V] learned part of the voltage
    tool: ToolTrace | None = None

    @property
    def is_cut(self):
        """Whether the cycle ended before its trajectory."""
        return len(self.error) < self.samples


def read_trace(path, cycle, machine, namespace):
    """Return the `Trace` of `cycle` of `machine` in the bag folder `path`; `BagError` if it cannot be read."""
    laser = f'{namespace}/laser'
    if not Path(path).exists():
        raise BagError(f'{path}: no such bag on this computer')
    command = {f'{namespace}/{joint}/command': [] for joint in machine.joints}
    taken = {**command, laser: []}
    for topic, _, data, _ in raw_messages(path, taken):
        if topic in command and len(data) != _COMMAND.itemsize:
            raise BagError(f'{path}: {topic}: a command has {len(data)} bytes; expected {_COMMAND.itemsize}')
        taken[topic].append(data)
    time, displacement = _laser_samples(f'{path}: {laser}', taken.pop(laser))
    columns = [np.frombuffer(b''.join(messages), _COMMAND) for messages in taken.values()]
    length = min(map(len, columns))
    if length == 0 or any(not np.array_equal(each['tick'][:length], columns[0]['tick'][:length]) for each in columns):
        raise BagError(f'{path}: has no tick with a command of every joint of {list(machine.joints)}')
    names = ('error', 'voltage', 'feedforward')
    error, voltage, feedforward = (np.stack([each[name][:length] for each in columns], axis=1) for name in names)
    motion, law, poses = _plan(path, namespace, machine)
    time = time - int(columns[0]['tick'][0]) * machine.sample_time
    within = slice(np.searchsorted(time, length * machine.sample_time))  # the laser measures on after a safe stop
    tool = tool_trace(cycle, time[within], displacement[within], poses, machine)
    return Trace(cycle, motion, law, 0 if poses is None else len(poses), error, voltage, feedforward, tool)


def _plan(path, namespace, machine):
    """Return motion, law and planned poses (N, m) of the cycle in a bag; '', '' and None without a trajectory."""
    topic, encoder, coordinates = (
        f'{namespace}/pose_trajectory',
        f'{namespace}/{machine.joints[0]}/encoder',
        machine.coordinates,
    )
    messages = read_topics(path, {topic}).get(topic)
    if not messages:
        return '', '', None
    with damage_refused(path):
        driven = extensions(read_topics(path, {encoder}).get(encoder, ())) if len(messages) > 1 else set()
        plan = planned(messages, driven)
        if tuple(plan.coordinates) != tuple(coordinates):
            raise BagError(f'{path}: {topic} has coordinates {list(plan.coordinates)}; expected {list(coordinates)}')
        return plan.motion, plan.learning_law, np.reshape(plan.position, (-1, len(coordinates)))


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
