"""
Singularities: determinant and conditioning of the Jacobian, and a proof that the travel has no singular position.

Source: (3.22)-(3.29), with det J_H of the phi of (2.19) and the boundary singularity PQ = 2 k10 in any direction, of
which the thesis's (3.28) is a special case.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.design.interval import Interval
from pkm_core.errors import PkmError, WorkspaceError


def regularity(machine, q):
    """
    Return {name: value} of the quantities that are all positive if and only if the mechanism is regular.

    These are gaps of sliders (3.27), heights of joints over their pivots (3.28), (3.29), the branch (2.15), and
    abs(det J). `q` is a sequence of n ndarrays or Intervals [m].

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> {name: round(float(value), 4) for name, value in regularity(planar, planar.home).items()}
    {'d3 - d1': 0.06, 'Y1': 0.0632, 'abs(det J)': 0.2372}

    """
    mechanism = machine.config.mechanism
    if mechanism == 'xy_stage':
        return {'abs(det J)': 0.0 * q[0] + 1.0}
    if mechanism not in ('planar', 'four_dof'):
        raise PkmError(
            f'{machine.name}: no proof for a {mechanism}; expected a planar, four_dof or xy_stage. pkm layouts prints '
            'its condition numbers'
        )
    geometry = machine.config.geometry
    l2_squared = _square(geometry.l2, q[0])
    gap1 = q[1] - q[0]
    Y1 = np.sqrt(l2_squared - 0.25 * gap1 * gap1)
    if mechanism == 'planar':
        return {'d3 - d1': gap1, 'Y1': Y1, 'abs(det J)': gap1 / (4.0 * Y1)}
    gap2 = q[2] - q[3]
    X2 = np.sqrt(l2_squared - 0.25 * gap2 * gap2)
    along_x = 0.5 * (q[0] + q[1]) - X2 - geometry.dx
    along_y = 0.5 * (q[2] + q[3]) - Y1 - geometry.dy
    Z = np.sqrt(_square(geometry.k10, q[0]) - 0.25 * (along_x * along_x + along_y * along_y))
    det_J_q = gap1 * gap2 / (16.0 * Y1 * X2)  # (3.26)
    det_J_H = 1.0 / (4.0 * Z)  # (3.25) but for the sign
    return {
        'd3 - d1': gap1,
        'd5 - d7': gap2,
        'Y1': Y1,
        'X2': X2,
        'x1 - x2': along_x,
        'y2 - y1': along_y,
        'Z': Z,
        'abs(det J)': det_J_H * det_J_q,
    }


def _square(length, like):
    """Return `length` squared; an Interval if `like` is one, because a product of constants is rounded."""
    return Interval(length, length) * length if isinstance(like, Interval) else length * length


class Bound(NamedTuple):
    """Proven lower bound of one quantity over the whole travel."""

    proven: float  # lower bound
    attained: float  # lowest evaluated value
    boxes: int  # number of parts of the travel in the proof


def bound_below(quantity, lower, upper, tolerance=0.01, most_boxes=200_000):
    """
    Return the `Bound` of a positive quantity over the box from `lower` to `upper`, by interval arithmetic.

    Parts whose interval bound is more than `tolerance` below the lowest attained value are halved.

    Parameters
    ----------
    quantity : callable
        Takes a sequence of n ndarrays or Intervals, returns one ndarray or Interval.
    lower, upper : sequence of n floats
        Corners of the box.
    tolerance : float
        Relative distance of the proven bound from the lowest value.
    most_boxes : int
        Largest number of parts.

    Raises
    ------
    WorkspaceError
        If the quantity is not positive everywhere, or the proof needs more than `most_boxes`.

    Examples
    --------
    >>> bound = bound_below(lambda x: x[0] * x[0] - x[1], [2.0, 0.0], [3.0, 1.0])
    >>> bound.attained, bound.proven > 0.99 * bound.attained
    (3.0, True)

    """
    low, high = (np.array([end], dtype=float) for end in (lower, upper))
    corners = np.stack(np.meshgrid(*np.concatenate([low, high]).T, indexing='ij')).reshape(len(lower), -1)
    attained, proven, done = float(np.min(quantity(corners))), np.inf, 0
    while len(low):
        attained = min(attained, float(np.min(quantity(0.5 * (low + high).T))))
        bounds = quantity([Interval(a, b) for a, b in zip(low.T, high.T, strict=True)]).lower
        finished = bounds >= (1.0 - tolerance) * attained
        if attained <= 0.0 or done + len(low) > most_boxes:
            raise WorkspaceError(
                f'regularity not proven: the quantity falls to {attained:.3g}, '
                f'its bound in {done + len(low)} boxes is {min(proven, bounds.min()):.3g}; allowed above 0'
            )
        done += int(finished.sum())
        proven = min(proven, bounds[finished].min(initial=np.inf))
        low, high = _halves(low[~finished], high[~finished])
    return Bound(float(proven), attained, done)


def _halves(low, high):
    widest = np.argmax(high - low, axis=1)[:, np.newaxis]
    middle = np.take_along_axis(0.5 * (low + high), widest, axis=1)
    left_high, right_low = high.copy(), low.copy()
    np.put_along_axis(left_high, widest, middle, axis=1)
    np.put_along_axis(right_low, widest, middle, axis=1)
    return np.concatenate([low, right_low]), np.concatenate([left_high, high])


def certificate(machine, tolerance=0.01):
    """
    Return {name: Bound} for every quantity of `regularity`: the proof that the travel has no singular position.

    Raises
    ------
    WorkspaceError
        If there is no proof; the message has the quantity and its bound.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> bound = certificate(load_machine('planar'))['d3 - d1']
    >>> round(bound.proven, 6), bound.boxes
    (0.02, 1)

    """
    bounds = {}
    for name in regularity(machine, machine.home):
        try:
            bounds[name] = bound_below(
                lambda q, name=name: regularity(machine, q)[name],
                machine.limits.lower,
                machine.limits.upper,
                tolerance,
            )
        except (WorkspaceError, ZeroDivisionError) as error:
            raise WorkspaceError(f'{machine.name}: {name}: {error}') from None
    return bounds


def conditioning(machine, q, length):
    """
    Return the condition number (...,) of the Jacobian at `q` (..., n), angles taken as arcs on a radius `length` [m].

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> four_dof = load_machine('four_dof')
    >>> round(float(conditioning(four_dof, four_dof.home, 0.05)), 3)
    11.962

    """
    scale = np.array([length if name == 'phi' else 1.0 for name in machine.coordinates])
    singular = np.linalg.svd(scale[:, np.newaxis] * machine.jacobian(q), compute_uv=False)
    return singular[..., 0] / singular[..., -1]
