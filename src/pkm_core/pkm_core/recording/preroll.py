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
        self._kept = deque(maxlen=ticks * (per_tick + 2))
        self.take = self._kept.append  # (topic, data, tick)
        self.clear = self._kept.clear
        self._trajectories = {}

    def take_trajectory(self, topic, data):
        """Take a trajectory; the last of each topic goes into every snapshot."""
        self._trajectories[topic] = data

    def save(self, folder, facts):
        """Write what is kept into a new bag in `folder` and return its path."""
        if not self._kept:
            raise BagError('nothing to keep: no message of the servo tick has come yet')
        newest = max(tick for *_, tick in self._kept)
        kept = [entry for entry in list(self._kept) if newest - self._ticks < entry[2] <= newest]
        oldest = min(tick for *_, tick in kept)
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
        for topic, data, tick in kept:
            bag.write(topic, data, tick * self._tick_ns)
        bag.close({})
        return bag.path
