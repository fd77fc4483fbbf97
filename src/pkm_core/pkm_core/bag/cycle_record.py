"""One recorded motion cycle as arrays: what a bag of the cell says, and the figures that follow from it."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.bag.reader import column, read_metadata, read_topics
from pkm_core.errors import BagError
from pkm_core.motion.metrics import axis_metrics

_RUN = 0  # EncoderSample.RUN


@dataclass(frozen=True)
class CycleRecord:
    """A cycle as recorded; arrays are (N, n): a row is a tick that every joint has answered, a column a joint."""

    path: Path
    motion: str
    learning_law: str
    cycle: int
    joints: tuple[str, ...]
    coordinates: tuple[str, ...]  # of the pose
    sample_time: float  # [s]
    samples: int  # ticks of the whole cycle; N is less after a safe stop
    ticks: np.ndarray  # (N,)
    counts: np.ndarray  # (N, n) int64
    position: np.ndarray  # (N, n) [m] measured
    reference: np.ndarray  # (N, n) [m]
    pose_reference: np.ndarray  # (N, m) [m, rad]
    voltage: np.ndarray  # (N, n) [V]
    error: np.ndarray  # (N, n) [m] reference minus measured, whatever the controller says of itself
    feedforward: np.ndarray  # (N, n) [V] learned part
    move_starts: np.ndarray  # (moves,) [samples]
    move_ends: np.ndarray
    laser_time: np.ndarray  # (K,) [s] from the first tick; K is 0 without a laser
    laser: np.ndarray  # (K, m) [m, rad] displacement of the end point from the laser's datum
    recorded: dict[str, int]  # messages by topic
    expected: dict[str, int]  # where the number is known
    facts: dict[str, str]  # what the recorder says of the recording

    @property
    def is_whole(self):
        """Whether every tick of the cycle is there."""
        return len(self.ticks) == self.samples

    def metrics(self):
        """Return one `AxisMetrics` a joint; the cycle must be whole."""
        return [axis_metrics(error, self.move_starts, self.move_ends, self.sample_time) for error in self.error.T]


def read_cycle(path, namespace=None):
    """
    Return the `CycleRecord` of the bag folder `path`; of the cell in `namespace`, by default the only one it holds.

    Only ticks that every joint has answered count: a cycle that ended in a safe stop is shorter than its trajectory.

    Raises
    ------
    BagError
        If `path` is no bag of this cell, or has a gap.

    """
    info = read_metadata(path)
    messages = read_topics(path)
    namespace = namespace or _namespace(path, messages)

    def trajectory_of(name):
        topic = f'{namespace}/{name}_trajectory'
        if topic not in messages:
            raise BagError(f'{path}: has no message on {topic}; expected a bag of the cell in {namespace}')
        message = messages[topic][-1]
        return message, np.reshape(message.position, (-1, len(message.coordinates)))

    (trajectory, reference), (poses, pose_reference) = trajectory_of('joint'), trajectory_of('pose')
    joints = tuple(trajectory.coordinates)
    samples, commands = [], []
    for joint in joints:
        samples.append([m for m in messages.get(f'{namespace}/{joint}/encoder', ()) if m.mode == _RUN])
        commands.append(messages.get(f'{namespace}/{joint}/command', []))
    length = min(map(len, samples + commands))
    ticks = column(commands[0][:length], 'tick')
    for joint, taken in zip(joints * 2, samples + commands, strict=True):
        if not np.array_equal(column(taken[:length], 'tick'), ticks) or np.any(np.diff(ticks) != 1):
            raise BagError(f'{path}: the ticks of {joint} have gaps; the bag is not complete')

    def stack(per_joint, field):
        return np.stack([column(taken[:length], field) for taken in per_joint], axis=1)

    index = column(samples[0][:length], 'index').astype(int)
    position = stack(samples, 'position')
    laser = messages.get(f'{namespace}/laser', [])
    start = trajectory.sample_time * (ticks[0] - index[0]) if length else 0.0
    facts = info.get('custom_data') or {}  # none in a bag that somebody else's recorder made
    return CycleRecord(
        path=Path(path),
        motion=trajectory.motion,
        learning_law=trajectory.learning_law,
        cycle=trajectory.cycle,
        joints=joints,
        coordinates=tuple(poses.coordinates),
        sample_time=trajectory.sample_time,
        samples=len(reference),
        ticks=ticks,
        counts=stack(samples, 'counts'),
        position=position,
        reference=reference[index],
        pose_reference=pose_reference[index],
        voltage=stack(commands, 'voltage'),
        error=reference[index] - position,
        feedforward=stack(commands, 'feedforward'),
        move_starts=np.array(trajectory.move_starts, dtype=int),
        move_ends=np.array(trajectory.move_ends, dtype=int),
        laser_time=column(laser, 'time') - start,
        laser=column(laser, 'displacement').reshape(-1, len(poses.coordinates)),
        recorded={t['topic_metadata']['name']: t['message_count'] for t in info['topics_with_message_count']},
        expected=json.loads(facts.get('expected', '{}')),
        facts={key: value for key, value in facts.items() if key != 'expected'},
    )


def _namespace(path, messages):
    """Return the namespace of the one cell that has spoken in a bag."""
    end = '/joint_trajectory'
    found = sorted(topic.removesuffix(end) for topic in messages if topic.endswith(end))
    if len(found) != 1:
        came = f'messages on {end} in the namespaces {found}' if found else f'no message on any {end}'
        raise BagError(f'{path}: has {came}; expected a bag of one cell')
    return found[0]
