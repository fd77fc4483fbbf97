"""
Basis functions of a learned feedforward, from the reference: forces on an axis that its model does not include.

Each is a force expressed as the equivalent voltage [V]; the parameter of a force known by design is then about 1.
"""

import numpy as np


def forces(machine, model, trajectory, column, slips, *, rested):
    """
    Return {name: voltage (N,) [V]} for the joint in `column` of a trajectory in joints.

    velocity, acceleration, jerk
        Errors of K, a and delay in the feedforward; the jerk over 1 ms.
    slip_...
        Friction: a force of 0.1 V against the direction of motion. It reverses within some micrometres of travel; each
        function is the sign of the speed with an exponential transition over one of the distances `slips` [m] (model
        of Dahl). A sudden sign(v) would act before the motion begins, and would drop at standstill.
    acceleration_...
        Acceleration of each other joint times the coupling term of the nominal design's M(q).
    configuration
        Change of the nominal design's own inertia, Coriolis and gravity force with the position.
    position, position_squared
        Own acceleration times the distance from home over half the travel, and times its square: position dependence
        of the thrust.

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
        Distances over which friction reverses [m].
    rested : bool
        Whether friction is at rest at the start of the cycle, as after power-up; else the same cycle precedes it.

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
    Return the friction z (N,) of a guide, relative to its Coulomb friction, along `position` (N,) [m].

    dz = (sgn(dx) - z) |dx|/length. `rested`: z starts at 0; else at its value after one preceding cycle.
    """
    step = np.diff(position, prepend=position[0] if rested else position[-1])
    sides, decays = np.sign(step).tolist(), np.exp(-np.abs(step) / length).tolist()
    z, course = 0.0, np.empty(position.size)
    for _ in range(1 if rested else 2):
        for k, (side, decay) in enumerate(zip(sides, decays, strict=True)):
            z = side + (z - side) * decay
            course[k] = z
    return course
