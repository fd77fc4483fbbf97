"""Contacts: stoppers at both ends of a guide, and colliding carriages (2.4)."""

from numba import njit


@njit(cache=True, error_model='numpy')
def contact_force(depth, rate, stiffness, damping):
    """
    Return the force [N] that pushes two bodies apart at a penetration `depth` [m] growing at `rate` [m/s].

    Hunt and Crossley (1975): k d (1 + c d'). The force is continuous at first contact and never attractive.
    """
    if depth <= 0.0:
        return 0.0
    return max(stiffness * depth * (1.0 + damping * rate), 0.0)
