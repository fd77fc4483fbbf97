"""The last moments of a cell, kept in memory for a snapshot."""

from collections import deque
from datetime import datetime

from pkm_core.errors import BagError
from pkm_core.recording.cycle import free_path, open_bag
from pkm_core.recording.topics import By


class PreRoll:
    """
    Keeps what came in the last ticks, recorded or not.

    Parameters
    ----------
    ticks : int
        How many.
    topics : dict of str to RecordedTopic
        By resolved name.
    sample_time_ns : int
        [ns]

    """

    def __init__(self, ticks, topics, sample_time_ns):
        self._ticks, self._topics, self._tick_ns = ticks, topics, sample_time_ns
        # one message a tick of every topic of the tick, and room for the rest, which is rarer
        per_tick = sum(topic.by is By.TICK for topic in topics.values())
        self._room, self._number = ticks * (per_tick + 2), 0
        self._kept = deque()  # blocks
        self._trajectories = {}

    def take(self, block):
        """Take messages; the oldest blocks go when all the others hold enough."""
        self._kept.append(block)
        self._number += len(block.ticks)
        while self._number - len(self._kept[0].ticks) >= self._room:
            self._number -= len(self._kept.popleft().ticks)

    def clear(self):
        """Forget everything but the trajectories."""
        self._kept.clear()
        self._number = 0

    def take_trajectory(self, topic, data):
        """Take a trajectory; the last of each topic goes into every snapshot."""
        self._trajectories[topic] = data

    def save(self, folder, facts):
        """Write what is kept into a new bag in `folder` and return its path."""
        if not self._kept:
            raise BagError('nothing to keep: no message of the servo tick has come yet')
        newest = max(int(block.ticks.max()) for block in self._kept)
        recent = [block.where(block.ticks > newest - self._ticks) for block in self._kept]
        kept = [block for block in recent if len(block.ticks)]
        oldest = min(int(block.ticks.min()) for block in kept)
        now = datetime.now().astimezone()
        metadata = {
            'snapshot': f'ticks {oldest} to {newest}',
            'recorded_at': now.isoformat(timespec='seconds'),
            **facts,
        }
        kinds = {name: topic.kind for name, topic in self._topics.items()}
        bag = open_bag(free_path(folder, f'snapshot_{newest:09d}_{now:%Y%m%dT%H%M%S}'), kinds, metadata)
        for topic, data in self._trajectories.items():
            bag.write(topic, data, oldest * self._tick_ns)
        for block in kept:
            bag.write_block(block.topic, block.messages, block.ticks * self._tick_ns)
        bag.close({})
        return bag.path
