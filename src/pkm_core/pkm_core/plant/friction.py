"""
Friction of one guide: elasto-plastic bristles with Stribeck curve (Dupont, Hayward, Armstrong, Altpeter, 2002).

It is the LuGre model with one change: below a share of their steady deflection the bristles deform elastically. A
carriage at rest then sits on a spring and keeps its position; LuGre and Dahl creep under vibration and a constant load.
Between that share and breakaway the carriage creeps by micrometres, as rolling guides do. Viscous friction is part of
the rigid model.
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
    and is 0 while the bristles swing back. The step uses alpha at its middle and is bounded by z_s: there is no chatter
    at any step size. The `damping` of the bristles decreases with the Stribeck curve, which keeps the model passive.
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
    if way < 1e-3:  # linear, accurate to 1e-7; the exact form cancels here
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
    """Return alpha at `bend` = z / z_s; without branches, which the processor would mispredict on a sliding guide."""
    rise = min(max((bend - elastic) / (1.0 - elastic), 0.0), 1.0)
    return rise * rise * (3.0 - 2.0 * rise)
