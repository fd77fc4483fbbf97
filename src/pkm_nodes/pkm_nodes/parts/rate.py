"""Rates in wall time, for diagnostics."""

from time import monotonic

from pkm_nodes.messages.diagnostics import LATE, LONGEST, TICK_RATE


class Rate:
    """The mean rate of a count since the last look at it."""

    def __init__(self):
        self._before = None

    def of(self, count):
        """Return the rate [1/s, wall] of `count`, as text; '0' at the first look, and after a count that fell."""
        now = monotonic()
        before, self._before = self._before, (count, now)
        if before is None or count < before[0] or now <= before[1]:
            return '0'
        return f'{(count - before[0]) / (now - before[1]):.0f}'


class TickRates:
    """Rate of the ticks and late answers of a `TickBarrier`, for the diagnostics of the machine."""

    def __init__(self, barrier):
        self._barrier, self._rate = barrier, Rate()

    def values(self):
        """Return the values by key; the rate is that since the last call."""
        barrier = self._barrier
        return {TICK_RATE: self._rate.of(barrier.tick), LATE: barrier.late, LONGEST: f'{barrier.longest:.3f}'}
