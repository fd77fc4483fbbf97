"""
Error budget by simulation of thousands of machines at given poses, in this process or on a dask cluster.

Machines are simulated in blocks, each with its own seed spawned from that of the study. The sums of the blocks are
added in order, so the result has the same bits for every distribution of blocks over processes and hosts.
"""

import asyncio
from typing import Any, NamedTuple

import numpy as np

from pkm_core.design.budget import linear_budget, sources
from pkm_core.design.specimen import end_point
from pkm_core.errors import PkmError

MACHINES_A_BLOCK = 2000  # the result for a seed depends on it
_BINS = 4000
_SPAN = 10.0  # half width of the histograms [largest linear standard deviation]


class Distribution(NamedTuple):
    """Errors of many machines; the last axis is that of the machine's coordinates [m, rad]."""

    machines: int
    mean: np.ndarray  # (poses, m) of the error
    deviation: np.ndarray  # (poses, m)
    edges: np.ndarray  # (bins + 1, m) of the histograms
    counts: np.ndarray  # (bins, m) of errors over all machines and poses; the outer bins hold the errors beyond

    def quantile(self, share):
        """Return the absolute error (m,) not exceeded by `share` of all machines and poses, to a bin's width."""
        below = np.cumsum(self.counts[_BINS // 2 :] + self.counts[_BINS // 2 - 1 :: -1], axis=0)
        index = np.argmax(below >= share * below[-1], axis=0)
        return np.take_along_axis(self.edges[_BINS // 2 + 1 :], index[np.newaxis], axis=0)[0]


def study_poses(machine, poses, seed):
    """Return joint positions (poses, n) [m] spread evenly over the travel, a scrambled Halton sequence."""
    from scipy.stats import qmc

    halton = qmc.Halton(len(machine.joints), rng=np.random.default_rng(seed))
    return qmc.scale(halton.random(poses), machine.limits.lower, machine.limits.upper)


def simulate_block(machine, tolerances, q, edges, geometry, machines, seed):
    """Return (sums, sums of squares, counts in the bins of `edges`) of the errors of `machines` machines at `q`."""
    draw = np.random.default_rng(seed)
    errors = {}
    for source in sources(machine, tolerances, q, geometry):
        value = source.spread.draw(draw, (machines, len(q) if source.each_pose else 1))
        for name, gain in source.effect.items():
            errors[name] = errors.get(name, 0.0) + gain * value
    with np.errstate(invalid='ignore'):
        error = end_point(machine, q, errors) - machine.forward(q)
    if not np.isfinite(error).all():
        raise PkmError('tolerances: too wide: the links of a machine do not meet at a pose')
    width = edges[1] - edges[0]
    bins = np.clip((error - edges[0]) / width, 0, _BINS - 1).astype(int)
    counts = [np.bincount(bins[..., i].ravel(), minlength=_BINS) for i in range(error.shape[-1])]
    return error.sum(axis=0), (error**2).sum(axis=0), np.stack(counts, axis=-1)


def monte_carlo_budget(machine, tolerances, q, machines, seed, scheduler=None, on_block=lambda: None, geometry=False):
    """
    Return the `Distribution` of the end-point error of `machines` machines at `q` (poses, n) [m].

    `scheduler` is the address of a dask scheduler, e.g. 'tcp://host:8786'; its workers need this package. `on_block` is
    called after each block. `geometry` is as in `sources`.

    Raises
    ------
    PkmError
        If the cluster cannot be reached, or the links of a machine do not meet.

    Examples
    --------
    >>> from pkm_core.design.tolerances import load_tolerances
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> found = monte_carlo_budget(planar, load_tolerances(), planar.home[np.newaxis], machines=20_000, seed=1)
    >>> (1e6 * found.deviation).round(1)  # um
    array([[16.9, 13.1]])

    """
    reach = _SPAN * linear_budget(machine, tolerances, q, geometry).total().max(axis=0)
    edges = reach * np.linspace(-1.0, 1.0, _BINS + 1)[:, np.newaxis]
    sizes = [min(MACHINES_A_BLOCK, machines - start) for start in range(0, machines, MACHINES_A_BLOCK)]
    blocks = list(zip(sizes, np.random.SeedSequence(seed).spawn(len(sizes)), strict=True))
    common = (machine, tolerances, q, edges, geometry)
    run = _here(common, blocks) if scheduler is None else _on_cluster(scheduler, common, blocks)
    sums: Any = 0  # arrays from the first block on
    squares: Any = 0
    counts: Any = 0
    for total, square, count in run:
        sums, squares, counts = sums + total, squares + square, counts + count
        on_block()
    mean = sums / machines
    deviation = np.sqrt(np.maximum(squares - machines * mean**2, 0.0) / max(machines - 1, 1))
    return Distribution(machines, mean, deviation, edges, counts)


def _here(common, blocks):
    for size, seed in blocks:
        yield simulate_block(*common, size, seed)


def _on_cluster(address, common, blocks):
    from distributed import Client

    try:
        asyncio.run(_knock(address))  # a Client without a scheduler hangs and logs errors at exit
    except (OSError, ValueError) as error:
        raise PkmError(f'dask scheduler {address!r}: {error}') from None
    with Client(address, set_as_default=False) as client:
        shared = client.scatter([common], broadcast=True)[0]
        futures = [client.submit(_remote, shared, size, seed, pure=False) for size, seed in blocks]
        for future in futures:  # in the order of the blocks, not of completion
            yield future.result()


async def _knock(address):
    from distributed.comm import connect

    comm = await connect(address, timeout=5.0)
    await comm.close()


def _remote(common, size, seed):
    return simulate_block(*common, size, seed)
