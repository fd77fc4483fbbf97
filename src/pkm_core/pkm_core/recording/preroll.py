"""The last messages of a cell, kept in memory for a snapshot."""

from collections import Counter, deque
from datetime import datetime
from itertools import chain

from pkm_core.errors import BagError
from pkm_core.recording.block import Block
from pkm_core.recording.cycle import free_path, open_bag


class PreRoll:
    """
    Keeps the messages of the last ticks, recorded or not.

    Parameters
    ----------
    ticks : int
        Number of ticks.
    topics : dict of str to RecordedTopic
        By resolved name.
    sample_time_ns : int
        [ns]

    """

    def __init__(self, ticks, topics, sample_time_ns):
        self._ticks, self._topics, self._tick_ns = ticks, topics, sample_time_ns
        self._kept: dict[str, deque[Block]] = {name: deque() for name in topics}
        self._numbers: Counter[str] = Counter()  # messages in `_kept`, by topic
        self._trajectories: dict[str, list[bytes]] = {}

    def take(self, block):
        """Add messages; remove blocks of their topic that are too old, or not needed for one message per tick."""
        kept, too_old = self._kept[block.topic], block.ticks[-1] - self._ticks
        kept.append(block)
        self._numbers[block.topic] += len(block.ticks)
        while kept[0].ticks[-1] <= too_old or self._numbers[block.topic] - len(kept[0].ticks) >= self._ticks:
            self._numbers[block.topic] -= len(kept.popleft().ticks)

    def clear(self):
        """Remove everything but the trajectories."""
        self._numbers.clear()
        for kept in self._kept.values():
            kept.clear()

    def take_trajectory(self, topic, data):
        """Add a trajectory; the last one of each topic is in every snapshot."""
        self._trajectories[topic] = [data]

    def take_piece(self, topic, data):
        """Add a piece of a jog to its trajectory."""
        self._trajectories.get(topic, []).append(data)

    def save(self, folder, facts):
        """Write the messages into a new bag in `folder`; return its path, or raise `BagError` without a message."""
        blocks = [*chain(*self._kept.values())]
        if not blocks:
            raise BagError('snapshot: no message of the servo tick has arrived yet')
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
        for topic, parts in self._trajectories.items():
            for data in parts:
                bag.write(topic, data, oldest * self._tick_ns)
        for block in kept:
            bag.write_block(block.topic, block.messages, block.ticks * self._tick_ns)
        bag.close({})
        return bag.path
