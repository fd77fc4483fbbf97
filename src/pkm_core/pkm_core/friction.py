"""
Friction of one guide: elasto-plastic bristles with Stribeck curve (Dupont, Hayward, Armstrong, Altpeter, 2002).

LuGre's model, but bristles that bend by less than a share of their steady bend do so elastically: a carriage at rest sits
on a spring of some 50 N/mm and stays where it is, where LuGre and Dahl creep away under vibration and a constant load.
Beyond, up to breakaway, it creeps by micrometres, as rolling guides do. Viscous friction is part of the rigid model.
"""

import math

from numba import njit


@njit(cache=True)
def bristle_step(bristle, speed, duration, coulomb, breakaway, stribeck_speed, stiffness, damping, elastic):
    """
    Return (bristle deflection [m], mean force against the motion [N]) after `duration` at constant `speed`.

    z' = v (1 - alpha(z, v) z / z_s), stiffness |z_s| = coulomb (1 + (breakaway - 1) exp(-(v / stribeck_speed)^2)), z_s with
    the sign of v. alpha rises from 0 at z = elastic z_s to 1 at z_s, and is 0 while the bristles swing back. Integrated
    with alpha of the middle of the step and bounded by z_s, so no step size makes it chatter. The `damping` of the
    bristles fades with the Stribeck curve, which keeps the model passive.
    """
    if coulomb <= 0.0:
        return 0.0, 0.0
    ratio = speed / stribeck_speed
    curve = math.exp(-ratio * ratio)
    steady = coulomb * (1.0 + (breakaway - 1.0) * curve) / stiffness
    forward = math.copysign(1.0, speed)  # in the following z counts along the motion
    start = forward * bristle
    travelled = abs(speed) * duration
    rate = _plastic_share(start / steady, elastic) / steady  # per metre travelled
    middle = start + 0.5 * travelled * (1.0 - rate * start)
    rate = _plastic_share(middle / steady, elastic) / steady
    end = start + travelled
    if rate > 0.0:
        end = start - (1.0 / rate - start) * math.expm1(-rate * travelled)
    if rate * travelled > 1e-3:
        mean = (1.0 - (end - start) / travelled) / rate
    else:  # the same to 1e-7, without its cancellation
        mean = 0.5 * (start + end)
    if end > max(start, steady):
        end = max(start, steady)
        mean = 0.5 * (start + end)
    force = stiffness * mean + damping * curve * (end - start) / duration
    return forward * end, forward * force


@njit(cache=True)
def _plastic_share(bend, elastic):
    if bend <= elastic:
        return 0.0
    if bend >= 1.0:
        return 1.0
    return 0.5 - 0.5 * math.cos(math.pi * (bend - elastic) / (1.0 - elastic))
