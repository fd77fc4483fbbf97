"""One motion cycle on its way into a bag."""

import json
import re
from array import array
from collections import Counter
from datetime import datetime
from hashlib import sha256
from math import inf
from shutil import rmtree

import numpy as np

from pkm_core.bag_writer import BagWriter
from pkm_core.recording.topics import By

_COMMAND = 'pkm_interfaces/msg/MotorCommand'
# [bytes] where the learned feedforward, a double, is in a serialized MotorCommand
_FEEDFORWARD = slice(36, 44)


class CycleRecording:
    """
    Takes the messages of one cycle; they wait until its first tick and both trajectories are there.

    Parameters
    ----------
    number : int
        Of the cycle.
    topics : dict of str to RecordedTopic
        By resolved name.
    sample_time_ns : int
        [ns]

    """

    def __init__(self, number, topics, sample_time_ns):
        self.number = number
        self.motion, self.law = 'motion', 'none'
        self.trajectories = {}  # by topic; sent again every second until the cycle starts, the last one counts
        self.first_tick = self.last_tick = None
        self.end_tick = inf  # first tick that is not in it
        self.expected = {}  # messages by topic, known once the cycle has ended
        self.ended = None  # wall time [s]
        self.end = 'interrupted: the recorder ended before the cycle'
        self.counts = Counter()  # messages taken, by topic
        self.failure = ''  # why nothing more goes into its bag
        self.bag = None
        self._waiting = []  # (topic, data, tick or None for before the start)
        self._topics, self._tick_ns = topics, sample_time_ns
        self._ticks = {name: array('Q') for name, topic in topics.items() if topic.by is By.TICK}
        self._learned = {name: bytearray() for name, topic in topics.items() if topic.kind == _COMMAND}

    def is_ready(self):
        """Tell whether the bag can be opened: its name, its trajectories and its times are known."""
        return self.first_tick is not None and len(self.trajectories) == 2

    def holds(self, tick):
        """Tell whether `tick` is in it, as far as its ends are known."""
        return self.first_tick is not None and self.first_tick <= tick < self.end_tick

    def is_complete(self):
        """Tell whether the cycle has ended and everything it must hold has come."""
        return self.ended is not None and all(self.counts[t] >= count for t, count in self.expected.items())

    def take(self, topic, data, tick):
        """Take one message; `tick` is None before the first one."""
        self.counts[topic] += 1
        if self.bag is not None:
            self.bag.write(topic, data, (self.first_tick if tick is None else tick) * self._tick_ns)
        elif not self.failure:
            self._waiting.append((topic, data, tick))

    def take_tick(self, topic, data, tick):
        """Take one message of the servo tick, of which every one counts."""
        self.last_tick = tick
        self._ticks[topic].append(tick)
        if topic in self._learned:
            self._learned[topic] += data[_FEEDFORWARD]
        self.take(topic, data, tick)

    def open(self, folder, facts):
        """Open the bag in `folder` with `facts` in its metadata, and write what has waited."""
        now = datetime.now().astimezone()
        metadata = {
            'motion': self.motion,
            'cycle': str(self.number),
            'learning_law': self.law,
            'sample_time_s': repr(self._tick_ns * 1e-9),
            'recorded_at': now.isoformat(timespec='seconds'),
            **facts,
        }
        kinds = {name: topic.kind for name, topic in self._topics.items()}
        path = free_path(folder, f'{file_name(self.motion)}_{self.number:04d}_{now:%Y%m%dT%H%M%S}')
        self.bag = open_bag(path, kinds, metadata)
        for topic, data in self.trajectories.items():
            self.bag.write(topic, data, self.first_tick * self._tick_ns)
        for topic, data, tick in self._waiting:
            self.bag.write(topic, data, (self.first_tick if tick is None else tick) * self._tick_ns)
        self._waiting.clear()

    def fail(self, reason):
        """Let go of the bag after a failure; what is on the disk stays there for `pkm bag-doctor`."""
        self.failure = reason
        self._waiting.clear()
        if self.bag is not None:
            self.bag.abandon()
            self.bag = None

    def close(self):
        """Close the bag with the account of what should be in it; it is read back, see `BagWriter.close`."""
        facts = {
            'end': self.end,
            'expected': json.dumps(self.expected),
            'lost': json.dumps(self.lost()),
            'lost_ticks': json.dumps(self.lost_ticks()),
            'learned_feedforward': json.dumps({t: _digest(values) for t, values in self._learned.items()}),
        }
        self.bag.close(facts)

    def lost(self):
        """Return how many messages of each topic have not come; nothing for a topic that has all."""
        missing = {topic: count - self.counts[topic] for topic, count in self.expected.items()}
        return {topic: count for topic, count in missing.items() if count > 0}

    def lost_ticks(self):
        """Return the first and last of every run of ticks that have not come, by topic of the servo tick."""
        if self.ended is None:
            return {}
        found = {}
        for topic, ticks in self._ticks.items():
            end = self.first_tick + self.expected.get(topic, 0)
            missing = np.setdiff1d(np.arange(self.first_tick, end, dtype=np.uint64), ticks)
            if len(missing):
                parts = np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1)
                found[topic] = [[int(part[0]), int(part[-1])] for part in parts]
        return found


def open_bag(path, kinds, metadata):
    """Return a `BagWriter` at `path`; a folder that cannot take a bag is not left behind."""
    try:
        return BagWriter(path, kinds, metadata)
    except OSError:
        rmtree(path, ignore_errors=True)
        raise


def free_path(folder, name):
    """Return `folder`/`name`, with a number behind it if that exists."""
    path, number = folder / name, 1
    while path.exists():
        number += 1
        path = folder / f'{name}-{number}'
    return path


def file_name(text):
    """Return `text`, which anybody may have chosen, as a name that stays in its folder."""
    return re.sub(r'[^\w.-]', '_', text, flags=re.ASCII).lstrip('.')[:80] or 'motion'


def _digest(values):
    """Return 12 hex digits of the feedforward sequence in `values`, '' where nothing has been learned."""
    return sha256(values).hexdigest()[:12] if any(values) else ''
