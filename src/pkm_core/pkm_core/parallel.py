"""Executors of a search: processes of this computer, or a dask cluster."""

import asyncio
import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

from pkm_core.errors import PkmError
from pkm_core.interrupts import blocked, interruptible


@contextmanager
def search_executor(processes, cluster):
    """
    Yield a concurrent.futures executor of `processes` (0: one per processor), or of the dask scheduler at `cluster`.

    The workers of a cluster need this package.

    Raises
    ------
    PkmError
        If there is no scheduler at `cluster`.

    """
    if not cluster:
        with interruptible(), process_pool(processes or os.cpu_count()) as executor:
            yield executor
        return
    from distributed import Client

    try:
        asyncio.run(_knock(cluster))  # a Client without a scheduler would keep retrying in the background
    except (OSError, ValueError) as error:
        raise PkmError(f'--cluster: {cluster!r}: {error}') from None
    with Client(cluster, set_as_default=False) as client:
        yield client.get_executor()


def process_pool(processes):
    """
    Return an executor of `processes` worker processes of this computer; use it in a ``with`` block.

    The signal handlers of this process stay as they are: for a process with handlers of its own, such as a node.
    """
    # spawn instead of fork, because numba and the progress bar have threads
    return _Pool(processes, multiprocessing.get_context('spawn'), _end_with_parent)


class _Pool(ProcessPoolExecutor):
    """Worker processes that do not see Ctrl-C; an interrupted parent ends them instead of waiting for their work."""

    def submit(self, *arguments, **keywords):
        with blocked([signal.SIGINT]):  # it may start a worker, in which the signal stays blocked
            return super().submit(*arguments, **keywords)

    def __exit__(self, kind, *arguments):
        if kind is not None:
            self.shutdown(wait=False, cancel_futures=True)
            for worker in multiprocessing.active_children():
                worker.terminate()
        return super().__exit__(kind, *arguments)


def _end_with_parent():
    """End this worker when its parent ends; it would otherwise wait for work forever if the parent was killed."""

    def watch():
        parent = multiprocessing.parent_process()
        assert parent is not None  # in a worker process
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


async def _knock(address):
    from distributed.comm import connect

    comm = await connect(address, timeout=5.0)
    await comm.close()
