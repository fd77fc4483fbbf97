"""
Sorts the serialized messages of a cell into cycles and writes one bag of each.

A message tells by the tick, cycle or stamp it begins with where it belongs. Those of the servo tick come thousands of
times a second: they are put into a list until `sort` is called, and dealt with in blocks, many ticks of one topic at a
time. A bag is closed when everything its cycle must hold has come, or some time after its end. What cannot be written
costs its own cycle; the next one is tried again.
"""

from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import monotonic

import numpy as np

from pkm_core.bag.message_types import typestore
from pkm_core.errors import BagError
from pkm_core.recording.block import Block, numbers_at, rows, single
from pkm_core.recording.cycle import CycleRecording
from pkm_core.recording.preroll import PreRoll
from pkm_core.recording.topics import By, expected_messages

# [s, wall] how long a cycle that has ended may wait for the last of its messages
STRAGGLERS = 2.0
_EVENT = 'pkm_interfaces/msg/CycleEvent'


@dataclass(frozen=True)
class Outcome:
    """What has become of a cycle."""

    cycle: int
    tick: int  # last one
    path: Path | None  # of its bag
    messages: int = 0
    lost: dict[str, int] = field(default_factory=dict)  # messages by topic, and
    lost_ticks: dict[str, list] = field(default_factory=dict)  # the ticks of those of the servo tick
    failure: str = ''  # why there is no bag, or not all of it


class Recording:
    """
    The recording of a cell.

    Parameters
    ----------
    folder : Path
        Takes the bags.
    topics : dict of str to RecordedTopic
        What comes, by resolved name.
    machine : Machine
    preroll : float
        How much a snapshot reaches back [s] of simulated time.
    facts : callable
        ``facts(motion, law)`` gives what else the metadata of a bag say, a dict of str to str.
    warn : callable
        Takes a text about a message that cannot be recorded.
    is_offered : callable
        ``is_offered(topic)`` tells whether somebody publishes it.

    Attributes
    ----------
    takers : dict of str to callable
        By topic, what takes a serialized message, or several of equal size as the rows of an array of bytes.
    outcomes : list of Outcome
        Of the cycles closed since somebody emptied it.
    running : bool
        Whether cycles that start now are recorded.

    """

    def __init__(self, folder, topics, machine, preroll, facts, warn, is_offered):
        self._folder, self._topics, self._facts, self._warn = folder, topics, facts, warn
        self._is_offered = is_offered
        self._machine, self._tick_ns = machine, round(machine.sample_time * 1e9)
        self._preroll = PreRoll(max(1, round(preroll / machine.sample_time)), topics, self._tick_ns)
        self._types = typestore()
        # of the cell, from what its own topics are called: ('/pkm/',)
        self._spaces = tuple({name.removesuffix(t.name) for name, t in topics.items() if t.name[0] != '/'})
        self._cycles = {}
        self._closed = {}  # first tick that is not in it, by cycle
        self._states = []  # blocks of states and measurements that came before their tick
        self._ticks = {name: -1 for name, topic in topics.items() if topic.by is By.TICK}  # last tick by topic
        self._fresh = {name: [] for name in self._ticks}  # messages of the servo tick that are not sorted yet
        self.outcomes = []
        self.running = True
        self.takers = {name: self._taker(name, topic) for name, topic in topics.items()}

    def _taker(self, name, topic):
        if topic.by is By.TICK:
            return self._fresh[name].append
        takers: dict = {  # each takes the topic and the rows of its messages
            By.CYCLE: self._take_of_cycle,
            By.STAMP: partial(self._take_stamped, topic.stamp_at),
            By.TIME: self._take_timed,
            By.TRAJECTORY: self._take_trajectory,
            By.EVENT: self._take_events,
            By.ARRIVAL: self._take_arrival,
        }
        take = takers[topic.by]
        return lambda data: take(name, rows(data))

    @property
    def progress(self):
        """The last tick that every topic of the servo tick has reached, -1 before the first."""
        return min(self._ticks.values())

    # what the services ask for

    def start(self):
        """Record the cycles that start from now on; return what that means, in words."""
        was, self.running = self.running, True
        unrecorded = [c.number for c in self._cycles.values() if c.failure and c.first_tick is not None]
        more = f'; cycle {unrecorded[-1]} is running and stays unrecorded' if unrecorded else ''
        return 'recording already' if was else f'recording from the next cycle on{more}'

    def stop(self):
        """Record no cycle that starts from now on; return what that means, in words."""
        was, self.running = self.running, False
        if not was:
            return 'stopped already'
        open_ones = [cycle.number for cycle in self._cycles.values() if cycle.bag is not None]
        return f'stopped; cycle {open_ones[-1]} is recorded to its end' if open_ones else 'stopped'

    def split(self):
        """Go on in a new file of the running cycle's bag; return what has been done."""
        self.sort()
        for cycle in reversed(self._cycles.values()):
            if cycle.bag is not None:
                try:
                    cycle.bag.split()
                except (OSError, BagError) as error:
                    self._fail(cycle, error)
                    raise BagError(f'{cycle.failure}') from None
                return f'cycle {cycle.number} goes on in a new file of {cycle.bag.path}'
        raise BagError('no bag is open: no cycle is being recorded')

    def snapshot(self):
        """Write the pre-roll, recorded or not, into a bag of its own and return its path."""
        self.sort()
        try:
            return self._preroll.save(self._folder / 'snapshots', self._facts('', 'none'))
        except OSError as error:
            raise BagError(f'{self._folder}: {error.strerror or error}') from None

    # what comes

    def sort(self):
        """Sort what has come of the servo tick since the last call."""
        anything = False
        for topic, fresh in self._fresh.items():
            if not fresh:
                continue
            anything = True
            messages = rows(b''.join(fresh), size=rows(fresh[0]).shape[1])
            fresh.clear()
            ticks, numbers = numbers_at(messages, 4, '<i8'), numbers_at(messages, 12, '<u4')
            cuts = np.flatnonzero(numbers[1:] != numbers[:-1]) + 1
            for begin, end in pairwise([0, *cuts, len(numbers)]):  # of every cycle
                self._sort_block(Block(topic, messages[begin:end], ticks[begin:end]), int(numbers[begin]))
        if anything or self._states:
            self._place_states()
            for cycle in list(self._cycles.values()):
                self._keep_together(cycle)
                self._advance(cycle)

    def _keep_together(self, cycle):
        """See to it that a recorder that is killed now leaves the same ticks of every topic."""
        if cycle.bag is not None:
            try:
                cycle.bag.keep_together()
            except OSError as error:
                self._fail(cycle, error)

    def _sort_block(self, block, number):
        """Take a block of the servo tick that is all of cycle `number`."""
        cycle = self._cycles.get(number)
        if cycle is None:
            late = block.ticks < self._closed.get(number, 0)
            for _ in range(late.sum()):
                self._warn_of_late(block.topic, number)
            if late.all():
                return
            block, cycle = block.where(~late), self._cycle(number)
        if cycle.first_tick is None:
            self._start(cycle, int(block.ticks[0]))
        self._ticks[block.topic] = int(block.ticks[-1])
        self._preroll.take(block)
        try:
            cycle.take_ticks(block)
        except OSError as error:
            self._fail(cycle, error)

    def _take_of_cycle(self, topic, messages):
        self.sort()
        for message, number in zip(messages, numbers_at(messages, 4, '<u4').tolist(), strict=True):
            if number not in self._cycles and number in self._closed:
                self._warn_of_late(topic, number)
                continue
            cycle = self._cycle(number)
            self._put(cycle, single(topic, message, cycle.last_tick))

    def _take_stamped(self, stamp_at, topic, messages):
        if messages.shape[1] < stamp_at + 8:  # an array without elements
            return
        seconds = numbers_at(messages, stamp_at, '<i4').astype(np.int64)
        nanoseconds = seconds * 1_000_000_000 + numbers_at(messages, stamp_at + 4, '<u4')
        self._states.append(Block(topic, messages, nanoseconds // self._tick_ns))

    def _take_timed(self, topic, messages):
        nanoseconds = np.rint(numbers_at(messages, 4, '<f8') * 1e9).astype(np.int64)
        self._states.append(Block(topic, messages, nanoseconds // self._tick_ns))

    def _place_states(self):
        """Put the states whose tick has been taken into the last cycle that holds it; others may not know their end."""
        reached = max(self._ticks.values())
        states, self._states = self._states, []
        for block in states:
            early = block.ticks > reached
            if early.any():
                self._states.append(block.where(early))
            if not early.all():
                self._place(block.where(~early))

    def _place(self, block):
        self._preroll.take(block)
        for cycle in reversed(list(self._cycles.values())):
            held = cycle.holds(block.ticks)
            if held.any():
                self._put(cycle, block.where(held))
                block = block.where(~held)
        for tick in block.ticks:
            self._warn(f'{block.topic}: the state of tick {tick} is of no open cycle; not recorded')

    def _take_arrival(self, topic, messages):
        """Put messages that know no simulated time into the cycle that runs; between cycles there is none."""
        running = [cycle for cycle in self._cycles.values() if cycle.last_tick is not None and cycle.ended is None]
        for message in messages if running else ():
            if self._is_foreign(topic, message):
                continue
            block = single(topic, message, running[-1].last_tick)
            self._preroll.take(block)
            self._put(running[-1], block)

    def _is_foreign(self, topic, message):
        """Tell whether a message of diagnostics, a topic that all cells of a graph share, is of another cell."""
        statuses = self._types.deserialize_cdr(message.tobytes(), self._topics[topic].kind).status
        return bool(statuses) and not any(status.name.startswith(self._spaces) for status in statuses)

    def _take_trajectory(self, topic, messages):
        for message in messages:
            data = message.tobytes()
            self._preroll.take_trajectory(topic, data)
            trajectory = self._types.deserialize_cdr(data, self._topics[topic].kind)
            self._closed.pop(trajectory.cycle, None)  # a generator that was started anew counts from 1
            cycle = self._cycle(trajectory.cycle)
            cycle.motion, cycle.law = trajectory.motion, trajectory.learning_law
            cycle.trajectories[topic] = data
            cycle.counts[topic] = 1
            self._advance(cycle)

    def _take_events(self, topic, messages):
        self.sort()
        for message in messages:
            self._take_event(topic, message)

    def _take_event(self, topic, message):
        event = self._types.deserialize_cdr(message.tobytes(), _EVENT)
        if event.event in (event.RECORDED, event.NOT_RECORDED, event.RESET):
            return
        if event.cycle not in self._cycles and event.cycle in self._closed:
            self._warn_of_late(topic, event.cycle)
            return
        cycle = self._cycle(event.cycle)
        if event.event == event.STARTED:
            self._give_up_others(cycle)
            self._start(cycle, event.tick)
        if cycle.last_tick is not None:
            self._preroll.take(single(topic, message, cycle.last_tick))
        self._put(cycle, single(topic, message, event.tick or cycle.last_tick))
        if event.event in (event.FINISHED, event.FAULT) and cycle.first_tick is not None:
            finished = event.event == event.FINISHED
            cycle.end = 'finished' if finished else f'fault: {event.message}'
            cycle.end_tick = event.tick
            offered = {
                n: t for n, t in self._topics.items() if not t.optional or cycle.counts[n] or self._is_offered(n)
            }
            cycle.expected = expected_messages(offered, self._machine, cycle, event, finished)
            cycle.ended = monotonic()
            self._place_states()
            self._advance(cycle)

    # the life of a cycle

    def _cycle(self, number):
        """Return the recording of cycle `number`."""
        if number not in self._cycles:
            self._cycles[number] = CycleRecording(number, self._topics, self._tick_ns)
        return self._cycles[number]

    def _start(self, cycle, tick):
        """Note the first tick of `cycle`; older ones that never started are given up."""
        known, cycle.first_tick = cycle.first_tick is not None, tick
        if known:  # a tick was faster than the word on it
            return
        if tick <= self.progress:  # a machine that was switched on anew counts from 0
            self._ticks = dict.fromkeys(self._ticks, tick - 1)
            self._preroll.clear()
        if not self.running and not cycle.failure:
            self._fail(cycle, 'recording is stopped; the service recorder/record starts it again')
        self._cycles = {n: c for n, c in self._cycles.items() if c.first_tick is not None or n > cycle.number}

    def _give_up_others(self, started):
        """Close the cycles of a machine that starts another one and never told their end."""
        for cycle in list(self._cycles.values()):
            if cycle is not started and cycle.first_tick is not None and cycle.ended is None:
                cycle.end = f'interrupted: cycle {started.number} started without a word on its end'
                self._close_as_it_is(cycle)

    def _put(self, cycle, block):
        try:
            cycle.take(block)
        except OSError as error:
            self._fail(cycle, error)
        self._advance(cycle)

    def _advance(self, cycle):
        """Open the bag when it can be, close it when all is there."""
        if cycle.bag is None and not cycle.failure and cycle.is_ready():
            self._open(cycle)
        if cycle.is_complete() and (cycle.bag is not None or cycle.failure):
            self._close(cycle)

    def _open(self, cycle):
        try:
            cycle.open(self._folder, self._facts(cycle.motion, cycle.law))
        except OSError as error:
            self._fail(cycle, error)

    def close_late(self):
        """Close the cycles whose stragglers have not come; what is missing is said."""
        self.sort()
        for cycle in list(self._cycles.values()):
            if cycle.ended is not None and monotonic() - cycle.ended > STRAGGLERS:
                self._close_as_it_is(cycle)

    def close_all(self):
        """Close whatever is open, so that a cell that is stopped in the middle leaves whole bags."""
        self.sort()
        for cycle in list(self._cycles.values()):
            if cycle.first_tick is not None:
                self._close_as_it_is(cycle)

    def _close_as_it_is(self, cycle):
        if cycle.bag is None and not cycle.failure:  # its trajectories are among what is missing
            self._open(cycle)
        self._close(cycle)

    def _close(self, cycle):
        del self._cycles[cycle.number]
        self._closed[cycle.number] = cycle.end_tick
        if cycle.ended is not None:  # nothing more comes, or it is not waited for: a safe stop has no last command
            self._ticks = {topic: max(tick, cycle.end_tick - 1) for topic, tick in self._ticks.items()}
        if cycle.bag is None:
            return  # its failure has been told
        path, total = cycle.bag.path.resolve(), cycle.counts.total()
        try:
            cycle.close()
        except (OSError, BagError) as error:
            self._fail(cycle, error)
            return
        self.outcomes.append(Outcome(cycle.number, cycle.last_tick or 0, path, total, cycle.lost(), cycle.lost_ticks()))

    def _fail(self, cycle, error):
        """Note why nothing more of `cycle` is recorded, for whoever tells the user."""
        if cycle.failure:
            return
        path = cycle.bag.path.resolve() if cycle.bag is not None else None
        reason = f'{path or self._folder}: {error.strerror or error}' if isinstance(error, OSError) else str(error)
        if path is not None:
            reason += f'; what was written before can be had by: pkm bag-doctor {path}'
        cycle.fail(reason)
        self.outcomes.append(Outcome(cycle.number, cycle.last_tick or 0, path, failure=reason))

    def _warn_of_late(self, topic, number):
        self._warn(f'{topic}: a message of cycle {number} came after its bag was closed; not recorded')
