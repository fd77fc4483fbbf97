"""A call at a time of the monotonic clock, within tens of microseconds where the lock-step executor serves it."""

from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType


class Alarm:
    """
    Calls `ring()` once, at the time that was set last.

    The lock-step executor calls it from its loop of the tick, the executors of rclpy by a timer.

    Parameters
    ----------
    node : PkmNode
    ring : callable

    """

    def __init__(self, node, ring):
        self._node, self._ring = node, ring
        self._timer = node.create_timer(1.0, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()

    def set(self, due):
        """Ring at `due` [s, monotonic], and not at the time set before; called in a callback of the node."""
        executor = self._node.executor
        if hasattr(executor, 'set_alarm'):
            executor.set_alarm(due, self._ring)
            return
        self._timer.timer_period_ns = max(1, round(1e9 * (due - monotonic())))
        self._timer.reset()

    def _on_timer(self):
        self._timer.cancel()
        self._ring()
