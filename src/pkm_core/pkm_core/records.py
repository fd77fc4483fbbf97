"""One recorded motion cycle as arrays: what a bag of the cell says, and the figures that follow from it."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.bags import column, read_metadata, read_topics
from pkm_core.errors import BagError
from pkm_core.metrics import axis_metrics

_RUN = 0  # EncoderSample.RUN


@dataclass(frozen=True)
class CycleRecord:
    """A cycle as recorded; arrays are (N, n): a row is a tick, a column a joint."""

    path: Path
    motion: str
    learning_law: str
    cycle: int
    joints: tuple[str, ...]
    sample_time: float  # [s]
    ticks: np.ndarray  # (N,)
    counts: np.ndarray  # (N, n) int64
    voltage: np.ndarray  # (N, n) [V]
    error: np.ndarray  # (N, n) [m] reference minus measured
    feedforward: np.ndarray  # (N, n) [V] learned part
    move_starts: np.ndarray  # (moves,) [samples]
    move_ends: np.ndarray
    recorded: dict[str, int]  # messages by topic
    expected: dict[str, int]  # where the number is known

    def metrics(self):
        """Return one `AxisMetrics` a joint."""
        return [axis_metrics(error, self.move_starts, self.move_ends, self.sample_time) for error in self.error.T]


def read_cycle(path, namespace='/pkm'):
    """
    Return the `CycleRecord` of the bag folder `path`.

    Only ticks that every joint has answered count: a cycle that ended in a safe stop is shorter than its trajectory.

    Raises
    ------
    BagError
        If `path` is no bag of this cell.

    """
    trajectory_topic = f'{namespace}/joint_trajectory'
    trajectories = read_topics(path, [trajectory_topic])[trajectory_topic]
    if not trajectories:
        raise BagError(f'{path}: has no message on {trajectory_topic}; expected a bag of this cell in {namespace}')
    trajectory = trajectories[-1]
    joints = tuple(trajectory.coordinates)
    topics = [f'{namespace}/{joint}/{kind}' for joint in joints for kind in ('encoder', 'command')]
    messages = read_topics(path, topics)
    samples, commands = [], []
    for joint in joints:
        samples.append([m for m in messages[f'{namespace}/{joint}/encoder'] if m.mode == _RUN])
        commands.append(messages[f'{namespace}/{joint}/command'])
    length = min(map(len, commands))
    ticks = column(commands[0][:length], 'tick')
    for joint, taken in zip(joints * 2, samples + commands, strict=True):
        if not np.array_equal(column(taken[:length], 'tick'), ticks):
            raise BagError(f'{path}: the ticks of {joint} have gaps; the bag is not complete')

    def stack(per_joint, field):
        return np.stack([column(taken[:length], field) for taken in per_joint], axis=1)

    info = read_metadata(path)
    recorded = {topic['topic_metadata']['name']: topic['message_count'] for topic in info['topics_with_message_count']}
    return CycleRecord(
        path=Path(path),
        motion=trajectory.motion,
        learning_law=trajectory.learning_law,
        cycle=trajectory.cycle,
        joints=joints,
        sample_time=trajectory.sample_time,
        ticks=ticks,
        counts=stack(samples, 'counts'),
        voltage=stack(commands, 'voltage'),
        error=stack(commands, 'error'),
        feedforward=stack(commands, 'feedforward'),
        move_starts=np.array(trajectory.move_starts, dtype=int),
        move_ends=np.array(trajectory.move_ends, dtype=int),
        recorded=recorded,
        expected=json.loads(info['custom_data']['expected']),
    )
