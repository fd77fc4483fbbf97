"""Refusals of poses in the terms of the user: which coordinate may go how far, with the condition that is violated."""

import math

import numpy as np

from pkm_core.errors import WorkspaceError
from pkm_core.machines.checks import ANGLES

_STEPS = 80  # of the search on either side of the start
_BISECTIONS = 14  # from a step of the search to 1e-4 of it


def refuse_pose(machine, where, pose, start, reason):
    """
    Return the `WorkspaceError` for an unreachable `pose` (m,) [m, rad].

    It lists the coordinates of which a change alone makes the pose reachable, each with its reachable interval while
    the others are as in `pose`. If there is none, the intervals are those at `start`.

    Parameters
    ----------
    machine : Machine
        Has the limits.
    where : str
        Place of the pose in the input.
    pose : ndarray, shape (m,)
        The target.
    start : ndarray, shape (m,)
        A reachable pose before it.
    reason : WorkspaceError
        The violated condition.

    """
    names = machine.coordinates
    if not np.isfinite(pose).all():
        return WorkspaceError(f'{where}: {reason}')
    wrong = f'{_text(names, pose)} is out of reach'

    def reachable(values):
        try:
            machine.check_pose(values)
        except WorkspaceError:
            return False
        return True

    spans = [math.radians(60.0) if name in ANGLES else 2.0 * _travel(machine) for name in names]
    there = _intervals(names, pose, start, spans, reachable)
    if there:
        return WorkspaceError(f'{where}: {wrong}; there {"; or ".join(there)} ({reason})')
    here = _intervals(names, start, start, spans, reachable)
    return WorkspaceError(
        f'{where}: {wrong}, and no change of one coordinate alone suffices; from {_text(names, start)} on '
        f'{", ".join(here)} ({reason})'
    )


def refuse_joints(machine, where, start, by, reason):
    """
    Return the `WorkspaceError` for a displacement `by` (n,) [m] from the joint positions `start` (n,) [m].

    It has the interval of displacements of every joint for which a change of its displacement alone suffices; else of
    every joint alone. `reason` is the `WorkspaceError` of the violated condition.
    """

    def reachable(values):
        try:
            machine.check_joints(start + values)
            machine.forward(start + values)
        except WorkspaceError:
            return False
        return True

    names, still, spans = machine.joints, np.zeros(len(start)), [2.0 * _travel(machine)] * len(start)
    there = _intervals(names, np.asarray(by, dtype=float), still, spans, reachable, 'may move by')
    if not there:
        there = [', '.join(_intervals(names, still, still, spans, reachable, 'may move by')) + ' alone']
    return WorkspaceError(f'{where}: by {_text(names, by)} is out of reach; {"; or ".join(there)} ({reason})')


def _intervals(names, values, start, spans, reachable, verb='may go from'):
    """Return a sentence for each name whose entry of `values` has a reachable interval, the others as they are."""
    found = []
    for column, name in enumerate(names):
        interval = _interval(column, values, start[column], spans[column], reachable)
        if interval is None:
            continue
        scale, unit = _units(name)
        low, high = math.ceil(1e2 * scale * interval[0]) / 1e2, math.floor(1e2 * scale * interval[1]) / 1e2
        found.append(f'{name} {verb} {low:.2f} to {high:.2f} {unit}')
    return found


def _interval(column, values, start, span, reachable):
    """Return (low, high), the reachable interval of one entry next to its value, or None."""

    def at(entry):
        trial = np.array(values, dtype=float)
        trial[column] = entry
        return reachable(trial)

    grid = start + span * np.linspace(-1.0, 1.0, 2 * _STEPS + 1)
    inside = [index for index, entry in enumerate(grid) if at(entry)]
    if not inside:
        return None
    nearest = min(inside, key=lambda index: abs(grid[index] - values[column]))
    known, ends = set(inside), []
    for step in (-1, 1):
        last = nearest
        while last + step in known:
            last += step
        good, bad = grid[last], grid[last] + step * span / _STEPS
        for _ in range(_BISECTIONS):
            middle = 0.5 * (good + bad)
            good, bad = (middle, bad) if at(middle) else (good, middle)
        ends.append(good)
    return tuple(ends)


def _travel(machine):
    return float((machine.limits.upper - machine.limits.lower).max())


def _units(name):
    return (180.0 / math.pi, 'deg') if name in ANGLES else (1e3, 'mm')


def _text(names, values):
    """Return names and values with their units."""
    parts = []
    for name, value in zip(names, np.asarray(values).tolist(), strict=True):
        scale, unit = _units(name)
        parts.append(f'{name} {scale * value:.6g} {unit}')
    return ', '.join(parts)
