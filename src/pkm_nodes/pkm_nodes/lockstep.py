"""
The executor of the servo tick.

A tick is a chain of short callbacks: encoder samples wake the controllers, their commands wake the machine. rclpy's
executor builds a wait set over every service, timer and parameter of every node for each of them (0.3 ms a callback for
one node, several for a composed cell). Here the subscriptions of the tick, those in a `HotGroup`, have a wait set of
their own. While samples flow only that one is waited on, and every `_SERVE_EVERY` everything else is given a turn, so
parameters, services and timers are served without being waited for. When the flow ends, the ordinary executor takes all
subscriptions back and blocks until something happens, so an idle cell costs nothing.
"""

from time import perf_counter

import rclpy
from rclpy.callback_groups import CallbackGroup
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

# [s] how often parameters, services and timers get a turn while ticks flow, and the longest such turn
_SERVE_EVERY = 0.05
_SERVE_AT_MOST = 0.01
# [ns] silence after which the ordinary executor takes over
_QUIET = 5_000_000


class HotGroup(CallbackGroup):
    """Subscriptions of the servo tick; the ordinary executor serves them only while the flow stands still."""

    def __init__(self):
        super().__init__()
        self.flowing = False
        self.touched = False

    def can_execute(self, entity):
        """Tell the ordinary executor whether it may serve `entity` now."""
        return not self.flowing

    def beginning_execution(self, entity):
        """Note that a tick has come in through the ordinary executor: the flow begins."""
        self.touched = True
        return not self.flowing

    def ending_execution(self, entity):
        """Nothing to do: one thread serves everything."""


class LockstepExecutor(SingleThreadedExecutor):
    """A single-threaded executor with a fast lane for the subscriptions in `HotGroup`s."""

    def run(self):
        """Serve all nodes until the context is shut down."""
        while self._context.ok():
            self.spin_once()
            groups = [node.hot_group for node in self.get_nodes() if hasattr(node, 'hot_group')]
            if any(group.touched for group in groups):
                for group in groups:
                    group.flowing = True
                try:
                    self._run_flow()
                finally:
                    for group in groups:
                        group.flowing = group.touched = False

    def _run_flow(self):
        """Serve the tick until nothing has come for `_QUIET`."""
        hot = [s for node in self.get_nodes() for s in node.subscriptions if isinstance(s.callback_group, HotGroup)]
        handles = [subscription.handle for subscription in hot]
        take = {s.handle.pointer: (s.handle.take_message, s.msg_type, s.raw, s.callback) for s in hot}
        wait_set = _rclpy.WaitSet(len(handles), 0, 0, 0, 0, 0, self._context.handle)
        serve_at = perf_counter() + _SERVE_EVERY
        while self._context.ok():
            wait_set.clear_entities()
            for handle in handles:
                wait_set.add_subscription(handle)
            wait_set.wait(_QUIET)
            ready = wait_set.get_ready_entities('subscription')
            if not ready:
                return
            for pointer in ready:
                take_message, message_type, raw, callback = take[pointer]
                taken = take_message(message_type, raw)
                if taken is not None:
                    callback(taken[0])
            if perf_counter() > serve_at:
                self._serve_others()
                serve_at = perf_counter() + _SERVE_EVERY

    def _serve_others(self):
        """Give everything but the tick a turn, without waiting for anything."""
        end = perf_counter() + _SERVE_AT_MOST
        while perf_counter() < end:
            try:
                handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0)
            except (TimeoutException, ShutdownException):
                return
            handler()
            if handler.exception() is not None:
                raise handler.exception()


def spin(nodes):
    """Serve `nodes` in one lock-step executor until the context is shut down."""
    executor = LockstepExecutor(context=rclpy.get_default_context())
    for node in nodes:
        executor.add_node(node)
    executor.run()
