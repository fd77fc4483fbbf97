"""Waits of a coroutine in a node: for a condition, with a timeout in wall time."""

from math import inf

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.task import Future

# [s, wall] period of the looks at a condition
_PERIOD = 0.05


class Waiting:
    """
    The waits of `node`, one after the other.

    Examples
    --------
    In a coroutine callback of the node: ``met = await waiting.until(lambda: answer.done(), 5.0)``.

    """

    def __init__(self, node):
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._waits = []  # (condition, deadline, future)
        self._timer = node.create_timer(_PERIOD, self.look, clock=self._clock)
        self._timer.cancel()

    def until(self, condition, timeout=inf):
        """Return a future that becomes True when `condition()` holds, or False after `timeout` [s, wall]."""
        future = Future()
        self._waits.append((condition, self._now() + timeout, future))
        self._timer.reset()
        self.look()
        return future

    def look(self):
        """Look at every condition at once; the timer of the node does so periodically."""
        for wait in list(self._waits):
            condition, deadline, future = wait
            met = bool(condition())
            if met or self._now() > deadline:
                self._waits.remove(wait)
                future.set_result(met)
        if not self._waits:
            self._timer.cancel()

    def _now(self):
        return self._clock.now().nanoseconds * 1e-9
