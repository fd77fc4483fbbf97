"""Reach of one coordinate of a pose: how far it may change alone."""

import math

from pkm_core.errors import WorkspaceError
from pkm_core.machines.checks import ANGLES

_MARCH = 24  # steps from the pose to the farthest value; a gap narrower than one of them is not seen
_HALVINGS = 12


def reach(machine, pose, coordinate):
    """
    Return the lowest and the highest value of one coordinate that the machine reaches, the others unchanged.

    Travel of the sliders (2.4) and reach of the links (2.10) are those of `Machine.check_pose`.

    Parameters
    ----------
    machine : pkm_core.machines.base.Machine
        Its travel and links.
    pose : array_like, shape (m,)
        In `machine.coordinates` [m, rad].
    coordinate : str
        One of `machine.coordinates`.

    Returns
    -------
    tuple of float
        [m] or [rad]; both are the value in `pose` if the machine does not reach `pose`.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> [round(1e3 * end, 2) for end in reach(planar, planar.forward(planar.home), 'x')]
    [89.5, 129.5]

    """
    index, pose = machine.coordinates.index(coordinate), list(map(float, pose))
    start = pose[index]

    def is_reached(value):
        try:
            machine.check_pose([*pose[:index], value, *pose[index + 1 :]])
        except WorkspaceError:
            return False
        return True

    if not is_reached(start):
        return start, start
    span = math.pi if coordinate in ANGLES else 2.0 * float((machine.limits.upper - machine.limits.lower).max())
    return _end(is_reached, start, -span), _end(is_reached, start, span)


def _end(is_reached, start, span):
    """Return the last value that `is_reached` from `start` towards ``start + span``."""
    inside, step = start, span / _MARCH
    while abs(inside - start) < abs(span) and is_reached(inside + step):
        inside += step
    outside = inside + step
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if is_reached(middle) else (inside, middle)
    return inside
