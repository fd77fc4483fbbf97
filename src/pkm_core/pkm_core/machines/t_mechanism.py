"""
Two sliders on one guide with a link each, the links meeting in a joint at a height over the guide (thesis ch. 2).

It is singular where the two pivots coincide (3.27) and where the links lie flat (3.28), (3.29). The links that rise
from P and Q are one too, with PQ for the gap. Links are drawn alike; those of a built machine may differ.
"""

import numpy as np

from pkm_core.jet import value
from pkm_core.machines.checks import check_between


def joint_place(gaps, lower, higher, names, reason='between the singularities (3.27) and (3.29)'):
    """
    Return where the joint is, two (..., m) [m]: along the guide from the lower pivot, and over it; (2.5)-(2.7), (2.18).

    Parameters
    ----------
    gaps : ndarray or Jet, shape (..., m)
        Distance of the two pivots of each of m mechanisms [m].
    lower, higher : float or ndarray, shape (m,)
        Length of the link on the lower and on the higher slider [m].
    names : sequence of m str
        What the gaps are called if one is refused.
    reason : str
        The bound a refused gap violates.

    Raises
    ------
    WorkspaceError
        If a mechanism is singular or torn apart.

    """
    check_between(value(gaps), abs(lower - higher), lower + higher, names, reason)
    along = 0.5 * gaps + 0.5 * (lower * lower - higher * higher) / gaps
    return along, np.sqrt(lower * lower - along * along)


def joint_rates(gaps, along, height):
    """Return d along / d gap and d height / d gap (..., m) of arrays that `joint_place` took and gave."""
    rate = 1.0 - along / gaps
    return rate, -along / height * rate


def margins(gaps, lower, higher):
    """Return the distance (..., m) [m] of each gap from its nearest singular value, as in `joint_place`."""
    return np.minimum(gaps - abs(lower - higher), lower + higher - gaps)


def check_travel(joints, low, high, link):
    """Raise ValueError if the travel of the sliders `low` and `high` lets them meet (2.4) or tear the links (3.29)."""
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
    """Raise ValueError if a centre of mass named in `centres` lies beyond the end of its link, named `link`."""
    length = getattr(geometry, link)
    for name in centres:
        if getattr(geometry, name) > length:
            raise ValueError(f'{name} {getattr(geometry, name) * 1e3:g} mm; allowed 0 to {link} {length * 1e3:g} mm')
