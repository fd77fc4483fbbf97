"""How far the machine may be ahead of the recorder, so that no queue overflows. No ROS, no clock."""

from math import inf


class RecorderWindow:
    """
    The last tick that may begin, by the last one that is recorded.

    Parameters
    ----------
    ticks : int or None
        Allowed distance to the last recorded tick; None: no recorder is required.

    Attributes
    ----------
    ticks : int or None
    recorded : int
        Last recorded tick, -1 before the first report.
    last : int or float
        Last tick that may begin; inf without a recorder.

    """

    def __init__(self, ticks):
        self.ticks, self.recorded = ticks, -1
        self.last = inf if ticks is None else -1
        self._first, self._rest = 0, 0

    @property
    def is_missing(self):
        """Whether a required recorder has not reported yet."""
        return self.ticks is not None and self.recorded < 0

    def report(self, tick):
        """Note that every tick up to `tick` is recorded."""
        self.recorded = tick
        if self.ticks is not None:
            self.last = tick + self.ticks + (self._rest if tick < self._first else 0)

    def rested(self, rest, tick):
        """Note that the `rest` numbers before `tick`, the first of a cycle, belong to no tick."""
        self._first, self._rest = tick, rest
        self.last += rest
