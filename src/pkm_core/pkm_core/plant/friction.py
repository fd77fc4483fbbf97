"""
Friction of one guide: elasto-plastic bristles with Stribeck curve (Dupont, Hayward, Armstrong, Altpeter, 2002).

LuGre's model, but bristles that bend by less than a share of their steady bend do so elastically: a carriage at rest
sits on a spring and stays where it is, where LuGre and Dahl creep away under vibration and a constant load. Beyond, up
to breakaway, it creeps by micrometres, as rolling guides do. Viscous friction is part of the rigid model.
"""

import math

from numba import njit

_FAST = 6.0  # Stribeck speeds; exp(-36) is below the rounding of 1


@njit(cache=True, error_model='numpy')
def bristle_step(bristle, speed, duration, coulomb, breakaway, stribeck_speed, stiffness, damping, elastic):
    """
    Return (bristle deflection [m], mean force against the motion [N]) after `duration` at constant `speed`.

    z' = v (1 - alpha(z, v) z / z_s), stiffness |z_s| = coulomb (1 + (breakaway - 1) exp(-(v / stribeck_speed)^2)), z_s
    with the sign of v. alpha rises from 0 at z = elastic z_s to 1 at z_s (by a cubic, where the paper takes a sine),
    and is 0 while the bristles swing back. Integrated with alpha of the middle of the step and bounded by z_s, so no
    step size makes it chatter. The `damping` of the bristles fades with the Stribeck curve, which keeps the model
    passive.
    """
    if coulomb <= 0.0:
        return 0.0, 0.0
    ratio = speed / stribeck_speed
    curve = math.exp(-ratio * ratio) if abs(ratio) < _FAST else 0.0
    steady = coulomb * (1.0 + (breakaway - 1.0) * curve) / stiffness
    forward = math.copysign(1.0, speed)  # in the following z counts along the motion
    start = forward * bristle
    travelled = abs(speed) * duration
    rate = _plastic_share(start / steady, elastic) / steady  # per metre travelled
    middle = start + 0.5 * travelled * (1.0 - rate * start)
    rate = _plastic_share(middle / steady, elastic) / steady
    way = rate * travelled
    if way < 1e-3:  # straight to 1e-7, where the exact form cancels
        end = start + travelled * (1.0 - rate * start) * (1.0 - 0.5 * way)
        mean = 0.5 * (start + end)
    else:
        share = -math.expm1(-way) / way
        end = start + travelled * (1.0 - rate * start) * share
        mean = start * share + (1.0 - share) / rate
    bound = max(start, steady)
    end = min(end, bound)
    mean = min(mean, bound)
    force = stiffness * mean + damping * curve * (end - start) / duration
    return forward * end, forward * force


@njit(cache=True, error_model='numpy')
def _plastic_share(bend, elastic):
    """Return alpha at `bend` = z / z_s; without branches, which a sliding guide would take at random."""
    rise = min(max((bend - elastic) / (1.0 - elastic), 0.0), 1.0)
    return rise * rise * (3.0 - 2.0 * rise)
