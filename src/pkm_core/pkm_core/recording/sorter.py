"""
Sorts the serialized messages of a cell into cycles.

A message belongs to a cycle by its tick, cycle number or stamp. Messages of the servo tick arrive thousands of times
per second: they are collected until `Sorter.sort` is called and then sorted in blocks, many ticks of a topic at a time.
"""

from functools import partial
from itertools import pairwise

import numpy as np
from rosbags.serde import SerdeError

from pkm_core.bag.layout import layout_of
from pkm_core.bag.message_types import typestore
from pkm_core.errors import PkmError
from pkm_core.recording.block import Block, numbers_at, rows, single
from pkm_core.recording.topics import By, is_at_standstill

_EVENT = 'pkm_interfaces/msg/CycleEvent'
_SECOND = 1_000_000_000  # ns
_LATEST = (1 << 63) - 1  # [ns] of a time in a bag


class Sorter:
    """
    Assigns messages to cycles.

    Parameters
    ----------
    topics : dict of str to RecordedTopic
        By resolved name.
    cycles : Cycles
    preroll : PreRoll
        Takes every message with a simulated time, recorded or not.
    sample_time_ns : int
        [ns]
    warn : callable
        Takes a text about a message that is not recorded.

    Attributes
    ----------
    takers : dict of str to callable
        By topic; takes one serialized message, or several of equal size as the rows of an (n, size) array of bytes.

    """

    def __init__(self, topics, cycles, preroll, sample_time_ns, warn):
        self._topics, self._cycles, self._preroll, self._warn = topics, cycles, preroll, warn
        self._tick_ns, self._latest_tick = sample_time_ns, _LATEST // sample_time_ns
        self._types = typestore()
        self._places = {name: layout_of(topic.kind).places for name, topic in topics.items()}
        self._sizes = {name: layout_of(topic.kind).size for name, topic in topics.items()}
        # prefixes of the cell, from the names of its own topics: ('/pkm/',)
        self._spaces = tuple({name.removesuffix(t.name) for name, t in topics.items() if t.name[0] != '/'})
        self._fresh = {name: [] for name, topic in topics.items() if topic.by is By.TICK}  # messages to be sorted
        self._states: list[Block] = []  # states and measurements that arrived before their tick
        self.takers = {name: self._taker(name, topic) for name, topic in topics.items()}

    def _taker(self, name, topic):
        if topic.by is By.TICK:
            return self._fresh[name].append  # checked in `sort`, many at a time
        takers: dict = {  # each takes the topic and the rows of its messages
            By.CYCLE: self._take_of_cycle,
            By.STAMP: partial(self._take_stamped, topic.stamp),
            By.TIME: self._take_timed,
            By.TRAJECTORY: self._take_trajectories,
            By.EVENT: self._take_events,
            By.ARRIVAL: self._take_arrival,
        }
        return partial(self._take, takers[topic.by], name)

    def _take(self, take, topic, data):
        messages = rows(data)
        try:
            take(topic, messages)
        except PkmError:
            raise
        except (ValueError, TypeError, IndexError, KeyError, OverflowError, AssertionError, SerdeError) as error:
            # rosbags and numpy raise these for bytes that are no message of this type
            self._warn(f'{topic}: message of {messages.shape[1]} bytes cannot be read; not recorded: {error}')

    def sort(self):
        """Sort the messages of the servo tick that arrived since the last call."""
        anything = False
        for topic, fresh in self._fresh.items():
            if not fresh:
                continue
            messages = self._joined(topic, fresh)
            fresh.clear()
            if not len(messages):
                continue
            anything = True
            places = self._places[topic]
            # signed, because numpy mixes uint64 and int64 to float64
            ticks = numbers_at(messages, places['tick']).view(np.int64)
            numbers = numbers_at(messages, places['cycle'])
            if ticks.min() < 0 or ticks.max() > self._latest_tick:
                held = self._in_time(topic, ticks)
                messages, ticks, numbers = messages[held], ticks[held], numbers[held]
                if not len(ticks):
                    continue
            cuts = np.flatnonzero(numbers[1:] != numbers[:-1]) + 1
            for begin, end in pairwise([0, *cuts, len(numbers)]):  # one block per cycle
                self._sort_block(Block(topic, messages[begin:end], ticks[begin:end]), int(numbers[begin]))
        if anything or self._states:
            self._place_states()
            for cycle in self._cycles:
                self._cycles.keep_together(cycle)
                self._cycles.advance(cycle)

    def _in_time(self, topic, ticks):
        """Return for each of `ticks` (n,) whether a bag has a time for it; warn of the others."""
        held = (ticks >= 0) & (ticks <= self._latest_tick)
        if not held.all():
            self._warn(f'{topic}: {np.count_nonzero(~held)} messages at no time of a bag; not recorded')
        return held

    def _joined(self, topic, fresh):
        """Return the messages `fresh` of the servo tick as an array (n, size); messages of another size are refused."""
        size = self._sizes[topic]
        joined = b''.join(fresh)
        if isinstance(fresh[0], np.ndarray) or len(joined) != size * len(fresh):
            blocks = [rows(each) for each in fresh]
            for block in blocks:
                if block.shape[1] != size:
                    self._warn(f'{topic}: message of {block.shape[1]} bytes; expected {size}; not recorded')
            joined = b''.join(block for block in blocks if block.shape[1] == size)
        return rows(joined, size=size)

    def _sort_block(self, block, number):
        """Take a block of the servo tick that belongs to cycle `number` as a whole."""
        if self._cycles.is_closed(number):
            late = block.ticks < self._cycles.end_of(number)
            for _ in range(late.sum()):
                self._warn_of_late(block.topic, number)
            if late.all():
                return
            block = block.where(~late)
        cycle = self._cycles.of(number)
        if cycle.first_tick is None:
            self._start(cycle, int(block.ticks[0]))
        self._cycles.progress.reach(block.topic, int(block.ticks[-1]))
        self._preroll.take(block)
        self._cycles.put_ticks(cycle, block)

    def _start(self, cycle, tick):
        """Start `cycle` with its first tick; a restarted machine counts from 0."""
        if self._cycles.start(cycle, tick) and tick <= self._cycles.progress.slowest:
            self._cycles.progress.restart(tick - 1)
            self._preroll.clear()

    def _take_of_cycle(self, topic, messages):
        self.sort()
        for message, number in zip(messages, self._numbers(topic, 'cycle', messages).tolist(), strict=True):
            if self._cycles.is_closed(number):
                self._warn_of_late(topic, number)
                continue
            cycle = self._cycles.of(number)
            self._cycles.put(cycle, single(topic, message, cycle.last_tick))

    def _numbers(self, topic, path, messages):
        """Return the field `path` of `messages`, (n,)."""
        return numbers_at(messages, self._places[topic][path])

    def _take_stamped(self, stamp, topic, messages):
        if messages.shape[1] < self._places[topic][f'{stamp}.nanosec'].offset + 4:  # a sequence without elements
            return
        seconds = self._numbers(topic, f'{stamp}.sec', messages).astype(np.int64)
        nanoseconds = _SECOND * seconds + self._numbers(topic, f'{stamp}.nanosec', messages)
        of_tick = ~is_at_standstill(nanoseconds, self._tick_ns)
        if of_tick.any():
            self._take_state(Block(topic, messages[of_tick], nanoseconds[of_tick] // self._tick_ns))

    def _take_timed(self, topic, messages):
        seconds = self._numbers(topic, 'time', messages)
        has_time = np.abs(seconds) < 1e-9 * _LATEST  # False for NaN
        nanoseconds = np.rint(1e9 * np.where(has_time, seconds, -1.0)).astype(np.int64)
        self._take_state(Block(topic, messages, nanoseconds // self._tick_ns))

    def _take_state(self, block):
        held = self._in_time(block.topic, block.ticks)
        if held.any():
            self._states.append(block.where(held))

    def _place_states(self):
        """Put the states up to the last tick into the newest cycle that holds it; an older one may have no end yet."""
        reached = self._cycles.progress.fastest
        states, self._states = self._states, []
        for block in states:
            early = block.ticks > reached
            if early.any():
                self._states.append(block.where(early))
            if not early.all():
                self._place(block.where(~early))

    def _place(self, block):
        self._preroll.take(block)
        for cycle in reversed(self._cycles):
            held = cycle.holds(block.ticks)
            if held.any():
                self._cycles.put(cycle, block.where(held))
                block = block.where(~held)
        for tick in block.ticks:
            self._warn(f'{block.topic}: the state of tick {tick} belongs to no open cycle; not recorded')

    def _take_arrival(self, topic, messages):
        """Put messages without a simulated time into the running cycle; between cycles they are not recorded."""
        running = self._cycles.current()
        for message in messages if running else ():
            if self._is_foreign(topic, message):
                continue
            block = single(topic, message, running.last_tick)
            self._preroll.take(block)
            self._cycles.put(running, block)

    def _is_foreign(self, topic, message):
        """Return whether a message of diagnostics, a topic shared by all cells of a graph, is of another cell."""
        statuses = self._types.deserialize_cdr(message.tobytes(), self._topics[topic].kind).status
        return bool(statuses) and not any(status.name.startswith(self._spaces) for status in statuses)

    def _take_trajectories(self, topic, messages):
        for message in messages:
            data = message.tobytes()
            trajectory = self._types.deserialize_cdr(data, self._topics[topic].kind)
            if trajectory.offset:
                self._take_piece(topic, message, trajectory.cycle)
                continue
            self._preroll.take_trajectory(topic, data)
            self._cycles.reopen(trajectory.cycle)
            cycle = self._cycles.of(trajectory.cycle)
            cycle.take_trajectory(topic, data, trajectory)
            self._cycles.advance(cycle)

    def _take_piece(self, topic, message, number):
        """Put a piece of a jog into its cycle; after the end only one that is missing, because it was driven."""
        self.sort()
        cycle = self._cycles.known(number)
        if cycle is None or topic not in cycle.trajectories:
            self._warn(f'{topic}: a piece of cycle {number}, whose bag is closed or lacks the first one; not recorded')
        elif cycle.ended is None or cycle.counts[topic] < cycle.expected[topic]:
            self._preroll.take_piece(topic, message.tobytes())
            self._cycles.put(cycle, single(topic, message, cycle.last_tick))

    def _take_events(self, topic, messages):
        self.sort()
        for message in messages:
            self._take_event(topic, message)

    def _take_event(self, topic, message):
        event = self._types.deserialize_cdr(message.tobytes(), _EVENT)
        if event.event in (event.RECORDED, event.NOT_RECORDED, event.RESET):
            return
        if event.tick * self._tick_ns > _LATEST:
            self._warn(f'{topic}: event of {event.source!r} at tick {event.tick}: no such time in a bag; not recorded')
            return
        if self._cycles.is_closed(event.cycle):
            self._warn_of_late(topic, event.cycle)
            return
        cycle = self._cycles.of(event.cycle)
        if event.event == event.STARTED:
            self._cycles.interrupt_others(cycle)
            self._start(cycle, event.tick)
        cycle.extensions += event.event == event.EXTENDED
        if cycle.last_tick is not None:
            self._preroll.take(single(topic, message, cycle.last_tick))
        self._cycles.put(cycle, single(topic, message, event.tick or cycle.last_tick))
        if event.event in (event.FINISHED, event.FAULT) and cycle.first_tick is not None:
            self._cycles.end(cycle, event)
            self._place_states()
            self._cycles.advance(cycle)

    def _warn_of_late(self, topic, number):
        self._warn(f'{topic}: a message of cycle {number} arrived after its bag was closed; not recorded')
