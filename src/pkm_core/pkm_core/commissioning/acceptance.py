"""Acceptance of new gains: the error of one cycle without learning, against a limit and the machine as found."""

import numpy as np

from pkm_core.control.systems import plant_system

WORSE = 1.1  # times the error as found, and
NOISE = 2e-6  # [m] more: the scatter of one cycle by friction
_SAMPLES = 1000  # of the step response; the loops settle within 0.2 s


def friction_error(gains, model, sample_time):
    """Return the largest error [m] after a reversal of Coulomb friction that nothing compensates; 0 without forces."""
    if model.forces is None:
        return 0.0
    controller, plant = gains.system(sample_time), plant_system(model, sample_time)
    x, v, largest = np.zeros(plant.B.size), np.zeros(controller.B.size), 0.0
    for _ in range(_SAMPLES):  # the plant has a delay: its output does not depend on the present input
        y = float(plant.C[0] @ x)
        command = -float(controller.C[0] @ v) - controller.D * y
        v = controller.A @ v + controller.B[:, 0] * y
        x = plant.A @ x + plant.B[:, 0] * (1.0 + command)
        largest = max(largest, abs(y))
    return 2.0 * model.forces.coulomb * largest


def excess(machine, as_found, tuned, limit, gains, models):
    """
    Return one text per reason against new gains.

    Parameters
    ----------
    machine : Machine
        Machine of the cycles.
    as_found, tuned : sequence of AxisMetrics
        Of all joints, in a cycle without learning with the gains as found and with the new ones.
    limit : float
        Allowed error [m] of an axis without friction; what friction alone explains is added.
    gains, models : dict of str to RobustGains, dict of str to AxisModel
        The new gains and the identified models.

    """
    reasons = []
    for joint, before, after in zip(machine.joints, as_found, tuned, strict=True):
        error, found = after.max_dynamic_error, before.max_dynamic_error
        friction = friction_error(gains[joint], models[joint], machine.sample_time)
        what = f'{joint}: error of the acceptance move {1e6 * error:.1f} um'
        if not error <= limit + friction:
            share = f', {1e6 * friction:.0f} um of it for friction' if friction else ''
            reasons.append(f'{what}; allowed {1e6 * (limit + friction):.4g} um{share}')
        elif not error <= max(WORSE * found, found + NOISE):
            reasons.append(f'{what}; {1e6 * found:.1f} um as found')
    return reasons
