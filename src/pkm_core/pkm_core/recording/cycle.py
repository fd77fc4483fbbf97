"""The recording of one motion cycle."""

import json
import re
from collections import Counter
from datetime import datetime
from hashlib import sha256
from math import inf
from shutil import rmtree
from time import monotonic

import numpy as np

from pkm_core.bag.layout import layout_of
from pkm_core.bag.writer import BagWriter
from pkm_core.recording.block import BEFORE, Block, numbers_at
from pkm_core.recording.topics import By

_COMMAND = 'pkm_interfaces/msg/MotorCommand'
_NO_TICKS = np.empty(0, np.int64)


class CycleRecording:
    """
    Writes the messages of one cycle into a bag; they are kept in memory until the bag is open.

    Parameters
    ----------
    number : int
        Number of the cycle.
    topics : dict of str to RecordedTopic
        By resolved name.
    sample_time_ns : int
        [ns]

    """

    def __init__(self, number, topics, sample_time_ns):
        self.number = number
        self.motion, self.law = 'motion', 'none'
        self.trajectories: dict[str, bytes] = {}  # by topic; resent every second until the cycle starts
        self.extensions = 0  # pieces of a jog that the machine has driven
        self.first_tick: int | None = None
        self.place = 0  # in the order in which cycles start, 0 before the first tick
        self.last_tick: int | None = None
        self.end_tick = inf  # first tick after the cycle
        self.expected: dict[str, int] = {}  # messages by topic, known once the cycle has ended or is closed
        self.ended: float | None = None  # wall time [s]
        self.latest = -inf  # wall time [s] of the last message
        self.end = 'interrupted: the recorder ended before the cycle'
        self.counts: Counter[str] = Counter()  # messages taken, by topic
        self.failure = ''  # why the recording of this cycle was stopped
        self.bag: BagWriter | None = None
        self._waiting: list[Block] = []
        self._topics, self._tick_ns = topics, sample_time_ns
        self._ticks = {name: [_NO_TICKS] for name, topic in topics.items() if topic.by is By.TICK}
        self._feedforward = layout_of(_COMMAND).places['feedforward']
        self._learned = {name: bytearray() for name, topic in topics.items() if topic.kind == _COMMAND}

    def is_ready(self):
        """Return whether the bag can be opened: its name, its trajectories and its times are known."""
        return self.first_tick is not None and len(self.trajectories) == 2

    def holds(self, ticks):
        """Return for each of `ticks` (n,) whether it belongs to this cycle, as far as its ends are known."""
        first = inf if self.first_tick is None else self.first_tick
        return (first <= ticks) & (ticks < self.end_tick)

    def is_complete(self):
        """Return whether the cycle has ended and every expected message has arrived."""
        return self.ended is not None and all(self.counts[t] >= count for t, count in self.expected.items())

    def take(self, block):
        """Add messages."""
        self.counts[block.topic] += len(block.messages)
        self.latest = monotonic()
        if self.bag is not None:
            self._write(self.bag, block)
        elif not self.failure:
            self._waiting.append(block)

    def take_ticks(self, block):
        """Add messages of the servo tick, whose ticks are accounted for one by one."""
        self.last_tick = int(block.ticks[-1])
        self._ticks[block.topic].append(block.ticks.copy())
        if block.topic in self._learned:
            self._learned[block.topic] += numbers_at(block.messages, self._feedforward).tobytes()
        self.take(block)

    def take_trajectory(self, topic, data, trajectory):
        """Add a trajectory, serialized and as a message; the last one of each topic is recorded."""
        self.motion, self.law = trajectory.motion, trajectory.learning_law
        self.trajectories[topic] = data
        self.counts[topic] = 1

    def _write(self, bag, block):
        ticks = np.array([self.first_tick]) if block.ticks[0] == BEFORE else block.ticks
        bag.write_block(block.topic, block.messages, ticks * self._tick_ns)

    def open(self, folder, facts):
        """Open the bag in `folder` with `facts` in its metadata, and write the messages kept so far."""
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
            self._write(self.bag, block)
        self._waiting.clear()
        self.bag.keep_together()

    def fail(self, reason):
        """Stop recording this cycle; the file stays as it is on the disk for `pkm bag-doctor`."""
        self.failure = reason
        self._waiting.clear()
        if self.bag is not None:
            self.bag.abandon()
            self.bag = None

    def end_facts(self):
        """Return the metadata of the end of the cycle: why, expected and missing messages, learned feedforward."""
        return {
            'end': self.end,
            'expected': json.dumps(self.expected),
            'lost': json.dumps(self.lost()),
            'lost_ticks': json.dumps(self.lost_ticks()),
            'surplus': json.dumps(self.surplus()),
            'learned_feedforward': json.dumps({t: _digest(values) for t, values in self._learned.items()}),
        }

    def reached(self):
        """Return the last tick by topic of the servo tick; the one before the first tick if it has no message."""
        before = -1 if self.first_tick is None else self.first_tick - 1
        return {name: max([before, *(int(t[-1]) for t in ticks if len(t))]) for name, ticks in self._ticks.items()}

    def lost(self):
        """Return the number of missing messages by topic; topics without a loss are left out."""
        missing = {topic: count - self.counts[topic] for topic, count in self.expected.items()}
        return {topic: count for topic, count in missing.items() if count > 0}

    def surplus(self):
        """Return the number of messages beyond the expected ones by topic: of a further publisher, or sent twice."""
        beyond = {topic: self.counts[topic] - count for topic, count in self.expected.items()}
        return {topic: count for topic, count in beyond.items() if count > 0}

    def lost_ticks(self):
        """Return the first and last of every run of missing ticks, by topic of the servo tick."""
        if self.first_tick is None:
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
    """Return a `BagWriter` at `path`; after an OSError no folder is left."""
    try:
        return BagWriter(path, kinds, metadata)
    except OSError:
        rmtree(path, ignore_errors=True)
        raise


def free_path(folder, name):
    """Return `folder`/`name`, with a number appended if that exists."""
    path, number = folder / name, 1
    while path.exists():
        number += 1
        path = folder / f'{name}-{number}'
    return path


def file_name(text):
    """Return `text`, which may be any string, as a file name without a path."""
    return re.sub(r'[^\w.-]', '_', text, flags=re.ASCII).lstrip('.')[:80] or 'motion'


def _digest(values):
    """Return 12 hex digits of the SHA-256 of the feedforward sequence `values`, '' if it is all zero."""
    return sha256(values).hexdigest()[:12] if any(values) else ''
