"""The barrier of a servo tick: the machine advances when every joint has answered, and not before."""

from math import isfinite

# [s] an answer that takes longer is late: a tick of a whole cell takes a five-hundredth of it
LATE = 0.05


class TickBarrier:
    """
    Collects the answers of all joints to one tick.

    `open` starts the wait for the answers to `tick`. The barrier is open until every joint has answered or `close` is
    called. A closed barrier accepts no answer. `answer` runs once per joint and tick and creates no object.

    Parameters
    ----------
    joints : int
        Number of joints, at least 1.
    timeout : float
        [s] wait for the answers of a tick after which `overdue` reports the missing joints.

    Attributes
    ----------
    tick : int
        Number of the current tick; it never decreases.
    volts : list of float, one per joint
        [V] the last accepted answer of each joint.
    stale : list of int, one per joint
        Number of answers that were not applied: to another tick, a second answer, or to a closed barrier.
    complaints : dict of int to str
        Why an answer to the current tick was refused, by joint.
    late : int
        Number of ticks of which `look` saw an answer missing for more than `LATE`.
    longest : float
        [s] the longest of these waits that `look` saw.

    """

    __slots__ = (
        *('_all', '_bits', '_late_tick', '_missing', '_opened_at', '_timeout'),
        *('complaints', 'late', 'longest', 'stale', 'tick', 'volts'),
    )

    def __init__(self, joints, timeout):
        self.tick = 0
        self.volts = [0.0] * joints
        self.stale = [0] * joints
        self.complaints = {}
        self._timeout = timeout
        self._bits = tuple(1 << joint for joint in range(joints))
        self._all = (1 << joints) - 1
        self._missing = 0  # one bit per joint without an accepted answer; 0 when the barrier is closed
        self._opened_at = 0.0
        self.late, self.longest, self._late_tick = 0, 0.0, -1

    @property
    def is_open(self):
        """Whether an answer to `tick` is missing."""
        return self._missing != 0

    @property
    def missing(self):
        """Indices of the joints without an accepted answer, ascending."""
        return [joint for joint, bit in enumerate(self._bits) if self._missing & bit]

    def open(self, now):
        """Wait for the answers of all joints to `tick` from `now` [s, monotonic] on."""
        self._missing = self._all
        self._opened_at = now

    def answer(self, joint, tick, voltage):
        """
        Take the answer of joint number `joint` to `tick`: `voltage` [V].

        Return whether it was the last missing one. An answer that does not fit is counted in `stale`. A voltage that
        is not finite leaves the joint missing and is noted in `complaints`.
        """
        bit = self._bits[joint]
        if tick != self.tick or not self._missing & bit:
            self.stale[joint] += 1
            return False
        if not isfinite(voltage):
            self.complaints[joint] = f'answered with {voltage} V; expected a finite voltage'
            return False
        self.volts[joint] = voltage
        self._missing ^= bit
        return not self._missing

    def next_tick(self):
        """Close the barrier, count one tick and return its number."""
        self._missing = 0
        self.complaints.clear()
        self.tick += 1
        return self.tick

    def close(self):
        """Accept no more answers to `tick`; the next answers to it are stale."""
        self._missing = 0
        self.complaints.clear()

    def waited(self, now):
        """Return the time since `open` [s]; `now` is [s, monotonic]."""
        return now - self._opened_at

    def look(self, now):
        """Count the current tick as late if an answer is missing for more than `LATE` at `now` [s, monotonic]."""
        if not self._missing or self.waited(now) <= LATE:
            return
        self.late += self.tick != self._late_tick
        self._late_tick, self.longest = self.tick, max(self.longest, self.waited(now))

    def overdue(self, now):
        """Return `missing` when the wait exceeds the timeout at `now` [s, monotonic], and [] before."""
        return self.missing if self._missing and now - self._opened_at > self._timeout else []
