"""One motion cycle on its way into a bag."""

import json
import re
from collections import Counter
from datetime import datetime
from hashlib import sha256
from math import inf
from shutil import rmtree

import numpy as np

from pkm_core.bag.writer import BagWriter
from pkm_core.recording.topics import By

_COMMAND = 'pkm_interfaces/msg/MotorCommand'
# [bytes] where the learned feedforward, a double, is in a serialized MotorCommand
_FEEDFORWARD = slice(36, 44)
_NO_TICKS = np.empty(0, np.int64)


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
        self._waiting = []  # blocks
        self._topics, self._tick_ns = topics, sample_time_ns
        self._ticks = {name: [_NO_TICKS] for name, topic in topics.items() if topic.by is By.TICK}
        self._learned = {name: bytearray() for name, topic in topics.items() if topic.kind == _COMMAND}

    def is_ready(self):
        """Tell whether the bag can be opened: its name, its trajectories and its times are known."""
        return self.first_tick is not None and len(self.trajectories) == 2

    def holds(self, ticks):
        """Tell for each of `ticks` (n,) whether it is in it, as far as its ends are known."""
        first = inf if self.first_tick is None else self.first_tick
        return (first <= ticks) & (ticks < self.end_tick)

    def is_complete(self):
        """Tell whether the cycle has ended and everything it must hold has come."""
        return self.ended is not None and all(self.counts[t] >= count for t, count in self.expected.items())

    def take(self, block):
        """Take messages."""
        self.counts[block.topic] += len(block.messages)
        if self.bag is not None:
            self._write(block)
        elif not self.failure:
            self._waiting.append(block)

    def take_ticks(self, block):
        """Take messages of the servo tick, of which every one counts."""
        self.last_tick = int(block.ticks[-1])
        self._ticks[block.topic].append(block.ticks.copy())
        if block.topic in self._learned:
            self._learned[block.topic] += block.messages[:, _FEEDFORWARD].tobytes()
        self.take(block)

    def _write(self, block):
        ticks = np.full(len(block.messages), self.first_tick) if block.ticks is None else block.ticks
        self.bag.write_block(block.topic, block.messages, ticks * self._tick_ns)

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
        for block in self._waiting:
            self._write(block)
        self._waiting.clear()
        self.bag.keep_together()

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
            missing = np.setdiff1d(np.arange(self.first_tick, end, dtype=np.int64), np.concatenate(ticks))
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
