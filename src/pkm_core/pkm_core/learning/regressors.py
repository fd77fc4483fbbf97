"""
What drives an axis besides its model: the shapes over time a learned feedforward may be made of, from the reference.

Each is a force as the voltage that makes it [V], so that the parameter of a thing known by design is about 1.
"""

import numpy as np


def forces(machine, model, trajectory, column, slips, *, rested):
    """
    Return {name: voltage (N,) [V]} for the joint in `column` of a trajectory in joints.

    velocity, acceleration, jerk
        What the feedforward's K, a and delay are off by; the jerk over 1 ms.
    slip_...
        Friction: a force that follows the direction of motion, 0.1 V. The guide turns over within some micrometres, so
        each is the sign of the speed behind one of the distances `slips` [m] (exponential, the model of Dahl). A
        sudden sign(v) would push before the motion has begun, and let go at standstill what friction holds.
    acceleration_...
        Of every other joint, times what the nominal design's M(q) couples.
    configuration
        What the nominal design's own inertia, Coriolis and gravity force change by with the position.
    position, position_squared
        Own acceleration times the distance from home over half the travel, and its square: a thrust that depends on
        where the magnets are.

    Parameters
    ----------
    machine : Machine
        For its nominal design.
    model : AxisModel
        Of the joint.
    trajectory : SampledTrajectory
        In joints.
    column : int
        Of the joint.
    slips : sequence of float
        Distances over which friction turns over [m].
    rested : bool
        Whether friction is at rest when the cycle begins, as after power-up; else the cycle follows one like itself.

    """
    joint, (q, qd, qdd, jerk) = machine.joints[column], trajectory.derivatives()
    own = qdd[:, column] / model.gain
    travel = machine.limits.upper[column] - machine.limits.lower[column]
    place = (q[:, column] - machine.home[column]) / (0.5 * travel)
    M = machine.mass_matrix(q)[:, column]
    design = machine.bias(q, qd) + machine.gravity(q) - machine.gravity(machine.home)
    change = (M[:, column] - machine.mass_matrix(machine.home)[column, column]) * qdd[:, column]
    return {
        'velocity': qd[:, column] * model.viscosity / model.gain,
        'acceleration': own,
        'jerk': 1e-3 * jerk[:, column] / model.gain,
        **{f'slip_{1e6 * length:g}um': 0.1 * slip(q[:, column], length, rested=rested) for length in slips},
        **{
            f'acceleration_{other}': M[:, k] * qdd[:, k] / machine.thrust_per_volt
            for k, other in enumerate(machine.joints)
            if other != joint
        },
        'configuration': (change + design[:, column]) / machine.thrust_per_volt,
        'position': own * place,
        'position_squared': own * place**2,
    }


def slip(position, length, *, rested):
    """
    Return the friction z (N,) of a guide over its Coulomb friction along `position` (N,) [m].

    dz = (sgn(dx) - z) |dx|/length. `rested`: z begins at 0; else with what one such cycle before would have left.
    """
    step = np.diff(position, prepend=position[0] if rested else position[-1])
    sides, decays = np.sign(step).tolist(), np.exp(-np.abs(step) / length).tolist()
    z, course = 0.0, np.empty(position.size)
    for _ in range(1 if rested else 2):
        for k, (side, decay) in enumerate(zip(sides, decays, strict=True)):
            z = side + (z - side) * decay
            course[k] = z
    return course
