"""A node served in turns at a fixed rate, instead of with every message."""

from contextlib import suppress
from time import monotonic, sleep

from rclpy.executors import ExternalShutdownException, ShutdownException, TimeoutException

from pkm_nodes.runtime.fast_path import FAST_PATH


def serve_in_turns(node, rate, before, after):
    """
    Serve `node` until its context is shut down.

    Parameters
    ----------
    node : rclpy.node.Node
        Without another executor.
    rate : float
        Turns per second of wall time.
    before, after : callable
        Called without arguments in each turn, before and after the messages that have arrived are served.

    """
    executor = FAST_PATH.stepped_executor(node.context)
    executor.add_node(node)
    while node.context.ok():
        next_turn = monotonic() + 1.0 / rate
        before()
        _serve_ready(executor)
        after()
        sleep(max(0.0, next_turn - monotonic()))


def _serve_ready(executor):
    """Serve all messages that have arrived, without waiting for more."""
    with suppress(TimeoutException, ShutdownException, ExternalShutdownException):
        while True:
            handler, _, _ = executor.wait_for_ready_callbacks(timeout_sec=0)
            handler()
            if handler.exception() is not None:
                raise handler.exception()
