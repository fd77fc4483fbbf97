"""Runs of experiments on processes or a dask cluster; the result does not depend on their distribution."""

from concurrent.futures import as_completed

from pkm_core.experiments.condition import prepared
from pkm_core.experiments.outcome import outcome
from pkm_core.experiments.simulated import simulate


def measure(condition, seed, cycles, laser=True):
    """Return the `Outcome` of `cycles` counted cycles of a `Condition`, without ROS."""
    records, notices = simulate(condition, seed, condition.settled + cycles, laser=laser)
    return outcome(condition, seed, records, notices, prepared(condition).machine)


def farm(executor, tasks, on_done=lambda done: None):
    """
    Return the results of `tasks`, tuples of a function and its arguments, in the order of `tasks`.

    `on_done` is called with the number of finished tasks. The first error cancels the tasks that have not started.
    """
    futures = [executor.submit(*task) for task in tasks]
    try:
        for done, future in enumerate(as_completed(futures), start=1):
            future.result()
            on_done(done)
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return [future.result() for future in futures]
