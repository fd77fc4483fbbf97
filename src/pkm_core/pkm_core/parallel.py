"""Where a search runs: in processes of this computer, or on a dask cluster."""

import asyncio
import multiprocessing
import os
import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

from pkm_core.errors import PkmError


@contextmanager
def search_executor(processes, cluster):
    """
    Yield a concurrent.futures executor of `processes` (0: one a processor), or of the dask scheduler at `cluster`.

    The workers of a cluster must have this package.
    """
    if not cluster:
        # spawned, not forked: numba and the progress bar have threads
        context = multiprocessing.get_context('spawn')
        with ProcessPoolExecutor(processes or os.cpu_count(), context, _end_with_parent) as executor:
            yield executor
        return
    from distributed import Client

    try:
        asyncio.run(_knock(cluster))  # a Client that finds nobody tries on in the background
    except (OSError, ValueError) as error:
        raise PkmError(f'--cluster: {cluster!r}: {error}') from None
    with Client(cluster, set_as_default=False) as client:
        yield client.get_executor()


def _end_with_parent():
    """Watch the parent from a worker, which would wait for work for ever if that was killed."""

    def watch():
        parent = multiprocessing.parent_process()
        assert parent is not None  # this is a worker
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


async def _knock(address):
    from distributed.comm import connect

    comm = await connect(address, timeout=5.0)
    await comm.close()
