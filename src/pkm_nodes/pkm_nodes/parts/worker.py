"""A process for computations that would disturb the tick; it starts with the first one."""

from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack

from pkm_core.parallel import process_pool


class Worker:
    """One process, used by one node."""

    def __init__(self):
        self._stack = ExitStack()
        self._pool = None

    def submit(self, work, *arguments):
        """Return the concurrent future of ``work(*arguments)``."""
        try:
            return self._running().submit(work, *arguments)
        except BrokenProcessPool:  # the process was killed
            self.close()
            return self._running().submit(work, *arguments)

    def _running(self):
        if self._pool is None:
            self._pool = self._stack.enter_context(process_pool(1))
        return self._pool

    def close(self):
        """End the process after its work."""
        self._stack.close()
        self._pool = None
