"""
Sorts the serialized messages of a cell into cycles and writes one bag of each.

A message tells by the tick, cycle or stamp it begins with where it belongs. Those of the servo tick are put into a list
until `sort` is called, for they come thousands of times a second. A bag is closed when everything its cycle must
hold has come, or some time after its end. What cannot be written costs its own cycle; the next one is tried again.
"""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from struct import unpack_from
from time import monotonic

from pkm_core.errors import BagError
from pkm_core.message_types import typestore
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

    Attributes
    ----------
    takers : dict of str to callable
        By topic, what takes its serialized messages.
    outcomes : list of Outcome
        Of the cycles closed since somebody emptied it.
    running : bool
        Whether cycles that start now are recorded.

    """

    def __init__(self, folder, topics, machine, preroll, facts, warn):
        self._folder, self._topics, self._facts, self._warn = folder, topics, facts, warn
        self._machine, self._tick_ns = machine, round(machine.sample_time * 1e9)
        self._preroll = PreRoll(max(1, round(preroll / machine.sample_time)), topics, self._tick_ns)
        self._types = typestore()
        self._cycles = {}
        self._closed = {}  # first tick that is not in it, by cycle
        self._states = []  # (tick, topic, data) of states and measurements that came before their tick
        self._fresh = []  # (topic, data) of the servo tick that are not sorted yet
        self._ticks = {name: -1 for name, topic in topics.items() if topic.by is By.TICK}  # last tick by topic
        self.outcomes = []
        self.running = True
        self.takers = {name: partial(self._taker(topic), name) for name, topic in topics.items()}

    def _taker(self, topic):
        takers = {
            By.TICK: self._take_tick,
            By.CYCLE: self._take_of_cycle,
            By.STAMP: partial(self._take_stamped, topic.stamp_at),
            By.TIME: self._take_timed,
            By.TRAJECTORY: self._take_trajectory,
            By.EVENT: self._take_event,
            By.ARRIVAL: self._take_arrival,
        }
        return takers[topic.by]

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

    def _take_tick(self, topic, data):
        self._fresh.append((topic, data))  # with its tick and cycle as the first fields after the 4-byte CDR header

    def sort(self):
        """Sort what has come of the servo tick since the last call."""
        fresh, self._fresh = self._fresh, []
        for topic, data in fresh:
            tick, number = unpack_from('<QI', data, 4)
            cycle = self._cycles.get(number)
            if cycle is None:
                if tick < self._closed.get(number, 0):
                    self._warn_of_late(topic, number)
                    continue
                cycle = self._cycle(number)
            if cycle.first_tick is None:
                self._start(cycle, tick)
            self._ticks[topic] = tick
            self._preroll.take((topic, data, tick))
            try:
                cycle.take_tick(topic, data, tick)
            except OSError as error:
                self._fail(cycle, error)
        if fresh or self._states:
            self._place_states()
            for cycle in list(self._cycles.values()):
                self._advance(cycle)

    def _take_of_cycle(self, topic, data):
        self.sort()
        number = unpack_from('<I', data, 4)[0]
        if number not in self._cycles and number in self._closed:
            self._warn_of_late(topic, number)
            return
        cycle = self._cycle(number)
        self._put(cycle, topic, data, cycle.last_tick)

    def _take_stamped(self, stamp_at, topic, data):
        if len(data) < stamp_at + 8:  # an array without elements
            return
        seconds, nanoseconds = unpack_from('<iI', data, stamp_at)
        self._states.append(((seconds * 1_000_000_000 + nanoseconds) // self._tick_ns, topic, data))

    def _take_timed(self, topic, data):
        nanoseconds = round(unpack_from('<d', data, 4)[0] * 1e9)
        self._states.append((nanoseconds // self._tick_ns, topic, data))

    def _place_states(self):
        """Put the states whose tick has been taken into the last cycle that holds it; others may not know their end."""
        reached = max(self._ticks.values())
        placed, self._states = [s for s in self._states if s[0] <= reached], [s for s in self._states if s[0] > reached]
        for tick, topic, data in placed:
            self._preroll.take((topic, data, tick))
            cycles = [cycle for cycle in self._cycles.values() if cycle.holds(tick)]
            if cycles:
                self._put(cycles[-1], topic, data, tick)
            else:
                self._warn(f'{topic}: the state of tick {tick} is of no open cycle; not recorded')

    def _take_arrival(self, topic, data):
        """Put a message that knows no simulated time into the cycle that runs; between cycles there is none."""
        running = [cycle for cycle in self._cycles.values() if cycle.last_tick is not None and cycle.ended is None]
        if running:
            self._preroll.take((topic, data, running[-1].last_tick))
            self._put(running[-1], topic, data, running[-1].last_tick)

    def _take_trajectory(self, topic, data):
        self._preroll.take_trajectory(topic, data)
        trajectory = self._types.deserialize_cdr(data, self._topics[topic].kind)
        self._closed.pop(trajectory.cycle, None)  # a generator that was started anew counts from 1
        cycle = self._cycle(trajectory.cycle)
        cycle.motion, cycle.law = trajectory.motion, trajectory.learning_law
        cycle.trajectories[topic] = data
        cycle.counts[topic] = 1
        self._advance(cycle)

    def _take_event(self, topic, data):
        self.sort()
        event = self._types.deserialize_cdr(data, _EVENT)
        if event.event in (event.RECORDED, event.NOT_RECORDED, event.RESET):
            return
        if event.cycle not in self._cycles and event.cycle in self._closed:
            self._warn_of_late(topic, event.cycle)
            return
        cycle = self._cycle(event.cycle)
        if event.event == event.STARTED:
            self._give_up_others(cycle)
            self._start(cycle, event.tick)
        tick = event.tick or cycle.last_tick
        if cycle.last_tick is not None:
            self._preroll.take((topic, data, cycle.last_tick))
        self._put(cycle, topic, data, tick)
        if event.event in (event.FINISHED, event.FAULT) and cycle.first_tick is not None:
            finished = event.event == event.FINISHED
            cycle.end = 'finished' if finished else f'fault: {event.message}'
            cycle.end_tick = event.tick
            cycle.expected = expected_messages(self._topics, self._machine, cycle, event, finished)
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

    def _put(self, cycle, topic, data, tick):
        try:
            cycle.take(topic, data, tick)
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
