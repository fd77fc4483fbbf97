"""
T-mechanism: two sliders on one guide with one link each, whose ends share a joint over the guide (thesis ch. 2).

It is singular where the two pivots coincide (3.27) and where the links lie flat (3.28), (3.29). The links on P and Q
form a third T-mechanism with PQ as its gap. The drawn links are equal; those of a built machine may differ.
"""

import numpy as np

from pkm_core.jet import value
from pkm_core.machines.checks import check_between


def joint_place(gaps, lower, higher, names, reason='between the singularities (3.27) and (3.29)'):
    """
    Return the position of the joint, two (..., m) [m]: along the guide from the lower pivot, and over the guide.

    Source: (2.5)-(2.7), (2.18).

    Parameters
    ----------
    gaps : ndarray or Jet, shape (..., m)
        Distance of the two pivots of each of m mechanisms [m].
    lower, higher : float or ndarray, shape (m,)
        Length of the link on the lower and on the higher slider [m].
    names : sequence of m str
        Names of the gaps in an error.
    reason : str
        Name of the violated bound in an error.

    Raises
    ------
    WorkspaceError
        If a mechanism is singular or its links do not reach.

    """
    check_between(value(gaps), abs(lower - higher), lower + higher, names, reason)
    along = 0.5 * gaps + 0.5 * (lower * lower - higher * higher) / gaps
    return along, np.sqrt(lower * lower - along * along)


def joint_rates(gaps, along, height):
    """Return d along / d gap and d height / d gap (..., m) for input and output of `joint_place`."""
    rate = 1.0 - along / gaps
    return rate, -along / height * rate


def margins(gaps, lower, higher):
    """Return the distance (..., m) [m] of each gap from its nearest singular value, as in `joint_place`."""
    return np.minimum(gaps - abs(lower - higher), lower + higher - gaps)


def check_travel(joints, low, high, link):
    """Raise ValueError if the sliders `low` and `high` could collide (2.4) or exceed the reach of the links (3.29)."""
    lower, higher = getattr(joints, low), getattr(joints, high)
    if not lower.upper < higher.lower:
        raise ValueError(
            f'joints.{low}.upper {lower.upper * 1e3:g} mm; allowed below '
            f'joints.{high}.lower {higher.lower * 1e3:g} mm (2.4)'
        )
    if not higher.upper - lower.lower < 2.0 * link:
        raise ValueError(
            f'joints.{high}.upper {higher.upper * 1e3:g} mm; allowed below '
            f'joints.{low}.lower + 2 l2 = {(lower.lower + 2.0 * link) * 1e3:g} mm (3.29)'
        )


def check_centres(geometry, centres, link):
    """Raise ValueError if a centre of mass named in `centres` is beyond the end of its link `link`."""
    length = getattr(geometry, link)
    for name in centres:
        if getattr(geometry, name) > length:
            raise ValueError(f'{name} {getattr(geometry, name) * 1e3:g} mm; allowed 0 to {link} {length * 1e3:g} mm')
