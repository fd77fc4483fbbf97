"""One recorded motion cycle as arrays, and the figures computed from them."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.bag.pieces import SAFE_STOP, extensions, planned
from pkm_core.bag.reader import column, damage_refused, read_metadata, read_topics
from pkm_core.errors import BagError
from pkm_core.motion.metrics import axis_metrics


@dataclass(frozen=True)
class CycleRecord:
    """A recorded cycle. Arrays are (N, n): one row per tick that every joint answered, one column per joint."""

    path: Path
    motion: str
    learning_law: str
    cycle: int
    joints: tuple[str, ...]
    coordinates: tuple[str, ...]  # of the pose
    sample_time: float  # [s]
    samples: int  # ticks of a complete cycle; N is less after a safe stop
    ticks: np.ndarray  # (N,)
    counts: np.ndarray  # (N, n) int64
    position: np.ndarray  # (N, n) [m] measured
    reference: np.ndarray  # (N, n) [m]
    pose_reference: np.ndarray  # (N, m) [m, rad]
    voltage: np.ndarray  # (N, n) [V]
    error: np.ndarray  # (N, n) [m] reference minus measured; the error in the controller's messages is not used
    feedforward: np.ndarray  # (N, n) [V] learned part of the voltage
    move_starts: np.ndarray  # (moves,) [samples]
    move_ends: np.ndarray
    laser_time: np.ndarray  # (K,) [s] from the first tick; K is 0 without a laser
    laser: np.ndarray  # (K, m) [m, rad] displacement of the end point from the laser's datum
    recorded: dict[str, int]  # number of messages by topic
    expected: dict[str, int]  # expected number of messages, for topics where it is known
    facts: dict[str, str]  # other metadata of the recorder

    @property
    def is_whole(self):
        """Whether the record has every tick of the cycle."""
        return len(self.ticks) == self.samples

    @property
    def moves(self):
        """Whether any joint moves in the cycle."""
        return bool(np.ptp(self.reference, axis=0).any())

    def metrics(self):
        """Return one `AxisMetrics` per joint; the cycle must be whole. A cycle without motion has no settling time."""
        found = [axis_metrics(error, self.move_starts, self.move_ends, self.sample_time) for error in self.error.T]
        return found if self.moves else [each.without_settling() for each in found]


def read_cycle(path, namespace=None):
    """
    Return the `CycleRecord` of a bag.

    Only ticks that every joint answered are kept: a cycle that ended in a safe stop is shorter than its trajectory.

    Parameters
    ----------
    path : Path
        Folder of the bag.
    namespace : str, optional
        Of the cell; by default that of the only cell in the bag.

    Raises
    ------
    BagError
        If `path` is no bag of a cell, or ticks are missing.

    """
    info, messages = read_metadata(path), read_topics(path)
    with damage_refused(path):
        return _checked(_record(path, info, messages, namespace))


def _record(path, info, messages, namespace):
    """Return the `CycleRecord` of the `messages` of a bag; any error if they contradict each other."""
    namespace = namespace or _namespace(path, messages)
    trajectory, reference = _trajectory(path, messages, namespace, 'joint')
    poses, pose_reference = _trajectory(path, messages, namespace, 'pose')
    samples, commands, ticks = _ticks(path, messages, namespace, tuple(trajectory.coordinates))
    index = column(samples[0], 'index').astype(int)
    position = _stack(samples, 'position')
    laser = messages.get(f'{namespace}/laser', [])
    start = trajectory.sample_time * (ticks[0] - index[0]) if len(ticks) else 0.0
    facts = info.get('custom_data') or {}  # absent in bags of other recorders
    return CycleRecord(
        path=Path(path),
        motion=trajectory.motion,
        learning_law=trajectory.learning_law,
        cycle=trajectory.cycle,
        joints=tuple(trajectory.coordinates),
        coordinates=tuple(poses.coordinates),
        sample_time=trajectory.sample_time,
        samples=len(reference),
        ticks=ticks,
        counts=_stack(samples, 'counts'),
        position=position,
        reference=reference[index],
        pose_reference=pose_reference[index],
        voltage=_stack(commands, 'voltage'),
        error=reference[index] - position,
        feedforward=_stack(commands, 'feedforward'),
        move_starts=np.array(trajectory.move_starts, dtype=int),
        move_ends=np.array(trajectory.move_ends, dtype=int),
        laser_time=column(laser, 'time') - start,
        laser=column(laser, 'displacement').reshape(-1, len(poses.coordinates)),
        recorded={t['topic_metadata']['name']: t['message_count'] for t in info['topics_with_message_count']},
        expected=_expected(path, facts),
        facts={key: value for key, value in facts.items() if key != 'expected'},
    )


def _expected(path, facts):
    expected = json.loads(facts.get('expected', '{}'))
    if not isinstance(expected, dict) or not all(isinstance(count, int) for count in expected.values()):
        raise BagError(f"{path}: custom_data 'expected' is no mapping of topics to counts")
    return expected


def _checked(record):
    """Return `record`; `BagError` if its numbers are not those of a cycle."""
    _require_times(record)
    for name in ('position', 'reference', 'pose_reference', 'voltage', 'feedforward', 'laser_time', 'laser'):
        if not np.isfinite(getattr(record, name)).all():
            raise BagError(f'{record.path}: {name} is not finite')
    return record


def _require_times(record):
    """Refuse a sample time or moves that no trajectory has."""
    starts, ends = record.move_starts, record.move_ends
    if not 0 < record.sample_time < np.inf:
        raise BagError(f'{record.path}: the sample time is {record.sample_time} s; expected a positive number')
    in_order = starts.shape == ends.shape and starts.size > 0 and (starts < ends).all()
    if not (in_order and starts[0] >= 0 and ends[-1] < record.samples and (ends[:-1] <= starts[1:]).all()):
        raise BagError(f'{record.path}: its moves are not in order within {record.samples} samples')


def _namespace(path, messages):
    """Return the namespace of the only cell with messages in the bag; `BagError` if there is none or several."""
    end = '/joint_trajectory'
    found = sorted(topic.removesuffix(end) for topic in messages if topic.endswith(end))
    if len(found) != 1:
        came = f'messages on {end} in the namespaces {found}' if found else f'no message on any {end}'
        raise BagError(f'{path}: has {came}; expected a bag of one cell')
    return found[0]


def _trajectory(path, messages, namespace, kind):
    """Return the last trajectory message of `kind`, 'joint' or 'pose', and its positions (samples, coordinates)."""
    topic = f'{namespace}/{kind}_trajectory'
    if topic not in messages:
        raise BagError(f'{path}: has no message on {topic}; expected a bag of the cell in {namespace}')
    joint = messages[f'{namespace}/joint_trajectory'][-1].coordinates[0]
    try:
        message = planned(messages[topic], extensions(messages.get(f'{namespace}/{joint}/encoder', ())))
    except BagError as error:
        raise BagError(f'{path}: {topic}: {error}') from None
    return message, np.reshape(message.position, (-1, len(message.coordinates)))


def _ticks(path, messages, namespace, joints):
    """
    Return encoder samples and commands, one list per joint, and their ticks (N,).

    The lists are cut to the ticks that every joint answered; `BagError` if ticks within them are missing.
    """
    samples, commands = [], []
    for joint in joints:
        samples.append([m for m in messages.get(f'{namespace}/{joint}/encoder', ()) if m.mode != SAFE_STOP])
        commands.append(messages.get(f'{namespace}/{joint}/command', []))
    length = min(map(len, samples + commands))
    samples, commands = ([taken[:length] for taken in lists] for lists in (samples, commands))
    ticks = column(commands[0], 'tick')
    for joint, taken in zip(joints * 2, samples + commands, strict=True):
        if not np.array_equal(column(taken, 'tick'), ticks) or np.any(np.diff(ticks) != 1):
            raise BagError(f'{path}: the ticks of {joint} have gaps; the bag is not complete')
    return samples, commands, ticks


def _stack(per_joint, field):
    """Return a field of the messages of every joint as an array (N, n)."""
    return np.stack([column(taken, field) for taken in per_joint], axis=1)
