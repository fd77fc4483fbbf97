"""
The life of the recorded cycles: each from its first message until its bag is closed.

A bag is opened when its cycle has its first tick and both trajectories. It is closed when everything the cycle must
have has arrived, or after its end when no more messages arrive. A write error ends the recording of its own cycle
only; the next cycle is recorded again.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic

from pkm_core.errors import BagError
from pkm_core.recording.cycle import CycleRecording
from pkm_core.recording.topics import By, expected_messages, expected_without_end

# [s, wall] how long a cycle that has ended waits for the next of its missing messages
STRAGGLERS = 2.0

# most cycles without a tick whose messages are kept
_MOST_IDLE = 20


@dataclass(frozen=True)
class Outcome:
    """Result of the recording of one cycle."""

    cycle: int
    tick: int  # last one
    path: Path | None  # of its bag
    messages: int = 0
    lost: dict[str, int] = field(default_factory=dict)  # number of missing messages by topic
    lost_ticks: dict[str, list] = field(default_factory=dict)  # first and last of each run of missing ticks, by topic
    surplus: dict[str, int] = field(default_factory=dict)  # number of messages beyond the expected ones by topic
    failure: str = ''  # why there is no bag, or only a part of it


class Progress:
    """The last tick of each topic of the servo tick, -1 before the first."""

    def __init__(self, topics):
        self._ticks = dict.fromkeys(topics, -1)

    @property
    def slowest(self):
        """The last tick that every topic has reached."""
        return min(self._ticks.values())

    @property
    def fastest(self):
        """The last tick that any topic has reached."""
        return max(self._ticks.values())

    def reach(self, topic, tick):
        """Note the last tick of `topic`."""
        self._ticks[topic] = tick

    def reach_all(self, tick):
        """Note that no topic needs to deliver `tick` or an earlier one any more."""
        self._ticks = {topic: max(reached, tick) for topic, reached in self._ticks.items()}

    def restart(self, tick):
        """Set every topic to `tick`."""
        self._ticks = dict.fromkeys(self._ticks, tick)


class Cycles:
    """
    The cycles that are being recorded.

    Parameters
    ----------
    folder : Path
        Folder of the bags.
    topics : dict of str to RecordedTopic
        By resolved name.
    machine : Machine
    facts : callable
        ``facts(motion, law)`` returns further metadata of a bag, a dict of str to str.
    is_offered : callable
        ``is_offered(topic)`` returns whether the topic has a publisher.

    Attributes
    ----------
    outcomes : list of Outcome
        Of the cycles closed since the caller last emptied it.
    running : bool
        Whether cycles that start now are recorded.
    progress : Progress

    """

    def __init__(self, folder, topics, machine, facts, is_offered):
        self._folder, self._topics, self._machine = folder, topics, machine
        self._facts: Callable[[str, str], dict[str, str]] = facts
        self._is_offered = is_offered
        self._tick_ns = round(machine.sample_time * 1e9)
        self._open: dict[int, CycleRecording] = {}
        self._ends: dict[int, float] = {}  # first tick after the cycle, by closed cycle
        self.progress = Progress(name for name, topic in topics.items() if topic.by is By.TICK)
        self.outcomes: list[Outcome] = []
        self.running = True
        self._started = 0  # number of cycles that have started

    def __iter__(self):
        """Iterate over the open cycles, oldest first; cycles may be closed meanwhile."""
        return iter(list(self._open.values()))

    def __reversed__(self):
        return reversed(list(self._open.values()))

    def of(self, number):
        """Return the recording of cycle `number`; a new one if it has none."""
        if number not in self._open:
            idle = [known for known, cycle in self._open.items() if cycle.first_tick is None]
            if len(idle) >= _MOST_IDLE:  # the cell has one or two: the others are of forged messages
                del self._open[idle[0]]
            self._open[number] = CycleRecording(number, self._topics, self._tick_ns)
        return self._open[number]

    def known(self, number):
        """Return the recording of cycle `number`, None if it has none or is closed."""
        return self._open.get(number)

    def is_closed(self, number):
        """Return whether cycle `number` is closed, and not open again."""
        return number not in self._open and number in self._ends

    def end_of(self, number):
        """Return the first tick after cycle `number`, which is closed."""
        return self._ends[number]

    def reopen(self, number):
        """Forget that `number` was closed: a restarted trajectory source counts from 1."""
        self._ends.pop(number, None)

    def current(self):
        """Return the newest cycle that has ticks and has not ended, or None."""
        running = [cycle for cycle in self._open.values() if cycle.last_tick is not None and cycle.ended is None]
        return running[-1] if running else None

    def start(self, cycle, tick):
        """Note the first tick of `cycle`, discard older cycles that never started; return whether the tick is new."""
        known, cycle.first_tick = cycle.first_tick is not None, tick
        if known:  # its first tick arrived before the STARTED event
            return False
        self._started += 1
        cycle.place = self._started
        if not self.running and not cycle.failure:
            self._fail(cycle, 'recording is stopped; the service recorder/record starts it again')
        self._open = {n: c for n, c in self._open.items() if c.first_tick is not None or n > cycle.number}
        return True

    def interrupt_others(self, started):
        """
        Close the cycles that have no end although the machine has `started` another one after them.

        On a loaded computer the STARTED event of a cycle may arrive after ticks of the next one.
        """
        before = started.place or self._started + 1
        for cycle in self:
            if cycle.first_tick is not None and cycle.place < before and cycle.ended is None:
                cycle.end = f'interrupted: cycle {started.number} started without an end event of this one'
                self._close_incomplete(cycle)

    def end(self, cycle, event):
        """Note the end of `cycle`, a FINISHED or FAULT event, and what it must have."""
        finished = event.event == event.FINISHED
        cycle.end = 'finished' if finished else f'fault: {event.message}'
        cycle.end_tick = event.tick
        cycle.expected = expected_messages(self._offered(cycle), self._machine, cycle, event, finished)
        cycle.ended = monotonic()

    def _offered(self, cycle):
        """Return the topics of which `cycle` must have messages."""
        return {n: t for n, t in self._topics.items() if not t.optional or cycle.counts[n] or self._is_offered(n)}

    def put(self, cycle, block):
        """Add messages to `cycle`."""
        try:
            cycle.take(block)
        except OSError as error:
            self._fail(cycle, error)
        self.advance(cycle)

    def put_ticks(self, cycle, block):
        """Add messages of the servo tick to `cycle`; `advance` follows when all topics have been sorted."""
        try:
            cycle.take_ticks(block)
        except OSError as error:
            self._fail(cycle, error)

    def keep_together(self, cycle):
        """Hand the same ticks of every topic to the operating system, so that a killed recorder leaves these."""
        if cycle.bag is not None:
            try:
                cycle.bag.keep_together()
            except OSError as error:
                self._fail(cycle, error)

    def advance(self, cycle):
        """Open the bag of `cycle` when it is ready and close it when it is complete."""
        if cycle.bag is None and not cycle.failure and cycle.is_ready():
            self._open_bag(cycle)
        if cycle.is_complete() and (cycle.bag is not None or cycle.failure):
            self._close(cycle)

    def split(self):
        """
        Continue the bag of the newest cycle in a new file; return that cycle.

        Raises
        ------
        BagError
            If no bag is open, or the file cannot be written.

        """
        for cycle in reversed(self):
            if cycle.bag is not None:
                try:
                    cycle.bag.split()
                except (OSError, BagError) as error:
                    self._fail(cycle, error)
                    raise BagError(cycle.failure) from None
                return cycle
        raise BagError('no bag is open: no cycle is being recorded')

    def close_late(self):
        """Close the cycles that ended and got no message for `STRAGGLERS`; their outcome names the missing ones."""
        for cycle in self:
            if cycle.ended is not None and monotonic() - max(cycle.ended, cycle.latest) > STRAGGLERS:
                self._close_incomplete(cycle)

    def close_all(self):
        """Close every cycle that has started: a recorder that is stopped leaves readable bags."""
        for cycle in self:
            if cycle.first_tick is not None:
                self._close_incomplete(cycle)

    def _open_bag(self, cycle):
        try:
            cycle.open(self._folder, self._facts(cycle.motion, cycle.law))
        except OSError as error:
            self._fail(cycle, error)

    def _close_incomplete(self, cycle):
        if cycle.bag is None and not cycle.failure:  # its trajectories are among the missing messages
            self._open_bag(cycle)
        if cycle.ended is None:  # its machine or this recorder has left
            cycle.expected = expected_without_end(self._offered(cycle), self._machine, cycle)
        self._close(cycle)

    def _close(self, cycle):
        del self._open[cycle.number]
        self._ends[cycle.number] = cycle.end_tick
        if cycle.ended is not None:  # a safe stop has no last command: its ticks are not waited for
            self.progress.reach_all(cycle.end_tick - 1)
        if cycle.bag is None:
            return  # its failure is among the outcomes already
        path, total = cycle.bag.path.resolve(), cycle.counts.total()
        try:
            cycle.bag.close(cycle.end_facts())
        except (OSError, BagError) as error:
            self._fail(cycle, error)
            return
        found = cycle.lost(), cycle.lost_ticks(), cycle.surplus()
        self.outcomes.append(Outcome(cycle.number, cycle.last_tick or 0, path, total, *found))

    def _fail(self, cycle, error):
        """Stop the recording of `cycle` and add the reason to the outcomes; once per cycle."""
        if cycle.failure:
            return
        path = cycle.bag.path.resolve() if cycle.bag is not None else None
        reason = f'{path or self._folder}: {error.strerror or error}' if isinstance(error, OSError) else str(error)
        if path is not None:
            reason += f'; recover what was written before with: pkm bag-doctor {path}'
        cycle.fail(reason)
        self.outcomes.append(Outcome(cycle.number, cycle.last_tick or 0, path, failure=reason))
