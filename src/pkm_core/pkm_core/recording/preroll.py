"""The last moments of a cell, kept in memory for a snapshot."""

from collections import Counter, deque
from datetime import datetime
from itertools import chain

from pkm_core.errors import BagError
from pkm_core.recording.cycle import free_path, open_bag


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
        self._kept = {name: deque() for name in topics}  # blocks by topic
        self._numbers = Counter()  # messages in them
        self._trajectories = {}

    def take(self, block):
        """Take messages; blocks of their topic go that are too old, or when the others hold one a tick."""
        kept, too_old = self._kept[block.topic], block.ticks[-1] - self._ticks
        kept.append(block)
        self._numbers[block.topic] += len(block.ticks)
        while kept[0].ticks[-1] <= too_old or self._numbers[block.topic] - len(kept[0].ticks) >= self._ticks:
            self._numbers[block.topic] -= len(kept.popleft().ticks)

    def clear(self):
        """Forget everything but the trajectories."""
        self._numbers.clear()
        for kept in self._kept.values():
            kept.clear()

    def take_trajectory(self, topic, data):
        """Take a trajectory; the last of each topic goes into every snapshot."""
        self._trajectories[topic] = data

    def save(self, folder, facts):
        """Write what is kept into a new bag in `folder` and return its path."""
        blocks = [*chain(*self._kept.values())]
        if not blocks:
            raise BagError('nothing to keep: no message of the servo tick has come yet')
        newest = max(int(block.ticks.max()) for block in blocks)
        recent = [block.where(block.ticks > newest - self._ticks) for block in blocks]
        kept = sorted((block for block in recent if len(block.ticks)), key=lambda block: block.ticks[0])
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
