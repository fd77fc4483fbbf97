"""
Friction of one guide: LuGre bristles with Stribeck curve (Canudas de Wit et al., 1995).

Below breakaway the carriage sits on a spring of some N/mm, so it sticks within micrometres and creeps, as rolling guides
do; with `breakaway` 1 and no damping it is Dahl's model. Viscous friction is part of the rigid model.
"""

import math

from numba import njit


@njit(cache=True)
def lugre_step(bristle, speed, duration, coulomb, breakaway, stribeck_speed, stiffness, damping):
    """
    Return (bristle deflection [m], mean force against the motion [N]) after `duration` at constant `speed`.

    The deflection z' = v - stiffness |v| / g(v) z is integrated exactly, so no step size makes it chatter; g runs from
    breakaway * coulomb at rest to coulomb. The bristle damping fades with the same curve, which keeps the model passive.
    """
    if coulomb <= 0.0:
        return 0.0, 0.0
    ratio = speed / stribeck_speed
    curve = math.exp(-ratio * ratio)
    level = coulomb * (1.0 + (breakaway - 1.0) * curve)
    steady = math.copysign(level / stiffness, speed)
    reached = steady + (bristle - steady) * math.exp(-stiffness * abs(speed) * duration / level)
    return reached, 0.5 * stiffness * (bristle + reached) + damping * curve * (reached - bristle) / duration
