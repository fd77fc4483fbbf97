"""The recording of a cell: serialized messages in, one bag per motion cycle and one outcome per bag out."""

from pkm_core.errors import BagError
from pkm_core.recording.cycles import Cycles
from pkm_core.recording.preroll import PreRoll
from pkm_core.recording.sorter import Sorter


class Recording:
    """
    The recording of a cell.

    Parameters
    ----------
    folder : Path
        Folder of the bags.
    topics : dict of str to RecordedTopic
        By resolved name.
    machine : Machine
    preroll : float
        Simulated time [s] that a snapshot reaches back.
    facts : callable
        ``facts(motion, law)`` returns further metadata of a bag, a dict of str to str.
    warn : callable
        Takes a text about a message that is not recorded.
    is_offered : callable
        ``is_offered(topic)`` returns whether the topic has a publisher.

    Attributes
    ----------
    takers : dict of str to callable
        By topic; takes one serialized message, or several of equal size as the rows of an (n, size) array of bytes.
    outcomes : list of Outcome
        Of the cycles closed since the caller last emptied it.

    """

    def __init__(self, folder, topics, machine, preroll, facts, warn, is_offered):
        tick_ns = round(machine.sample_time * 1e9)
        self._folder, self._facts = folder, facts
        self._preroll = PreRoll(max(1, round(preroll / machine.sample_time)), topics, tick_ns)
        self._cycles = Cycles(folder, topics, machine, facts, is_offered)
        self._sorter = Sorter(topics, self._cycles, self._preroll, tick_ns, warn)
        self.sort, self.takers = self._sorter.sort, self._sorter.takers
        self.outcomes = self._cycles.outcomes

    @property
    def progress(self):
        """The last tick that every topic of the servo tick has reached, -1 before the first."""
        return self._cycles.progress.slowest

    @property
    def running(self):
        """Whether cycles that start now are recorded."""
        return self._cycles.running

    def start(self):
        """Record the cycles that start from now on; return the effect as text."""
        was, self._cycles.running = self._cycles.running, True
        unrecorded = [cycle.number for cycle in self._cycles if cycle.failure and cycle.first_tick is not None]
        more = f'; cycle {unrecorded[-1]} is running and stays unrecorded' if unrecorded else ''
        return 'recording already' if was else f'recording from the next cycle on{more}'

    def stop(self):
        """Record no cycle that starts from now on; return the effect as text."""
        was, self._cycles.running = self._cycles.running, False
        if not was:
            return 'stopped already'
        recorded = [cycle.number for cycle in self._cycles if cycle.bag is not None]
        return f'stopped; cycle {recorded[-1]} is recorded to its end' if recorded else 'stopped'

    def split(self):
        """Continue the bag of the running cycle in a new file; return the effect as text, or raise `BagError`."""
        self.sort()
        cycle = self._cycles.split()
        return f'cycle {cycle.number} continues in a new file of {cycle.bag.path}'

    def snapshot(self):
        """Write the pre-roll, recorded or not, into a bag of its own; return its path, or raise `BagError`."""
        self.sort()
        try:
            return self._preroll.save(self._folder / 'snapshots', self._facts('', 'none'))
        except OSError as error:
            raise BagError(f'{self._folder}: {error.strerror or error}') from None

    def close_late(self):
        """Close the cycles whose missing messages have not arrived in time."""
        self.sort()
        self._cycles.close_late()

    def close_all(self):
        """Close every cycle that has started: a recorder that is stopped leaves readable bags."""
        self.sort()
        self._cycles.close_all()
