"""
What the other axes do to one axis, by the design of the machine, so that K_i means one thing in every experiment.

K_i is the acceleration a volt gives to axis i while the machine stands at home and the other axes are held. The masses
of config/machines are needed for what differs from that only, a few per cent of the whole.
"""

import numpy as np

from pkm_core.identification.partial_fractions import PartialFractions, mode_rows


def reaction_voltage(machine, reference, axis):
    """
    Return the voltage (N,) that joint number `axis` spends on what is not its own inertia at home.

    (M qdd + C + G)_i - M_ii(home) qdd_i over the thrust of one volt, along the `reference` (N, n) of all joints [m].
    """
    velocity = np.gradient(reference, machine.sample_time, axis=0)
    acceleration = np.gradient(velocity, machine.sample_time, axis=0)
    force = machine.inverse_dynamics(reference, velocity, acceleration)[:, axis]
    own = machine.mass_matrix(machine.home)[axis, axis] * acceleration[:, axis]
    return (force - own) / machine.thrust_per_volt


def coupling_factor(machine, axis, position, frequency, models, control):
    """
    Return by what factor (F,) the response of joint number `axis` differs from that with the others held at home.

    Shaken, the axis moves the others through the off-diagonal masses at `position` (n,) [m], and their loops answer:
    below their bandwidth they are held, above it they float, which makes the axis lighter. Series modes cancel.

    `frequency` (F,) is in Hz; `models` and `control` are those of all joints.
    """
    s = 2j * np.pi * frequency
    z = np.exp(s * machine.sample_time)
    drive = machine.thrust_per_volt * np.exp(-1.5 * s * machine.sample_time)  # with computation and hold
    design = machine.mass_matrix(np.stack([machine.home, position]))
    joints = [models[joint] for joint in machine.joints]
    mass = machine.thrust_per_volt / np.array([model.gain for model in joints])  # at home, with what the design lacks
    inertia = design[1] + np.diag(mass - np.diag(design[0]))
    stiffness = s[:, np.newaxis, np.newaxis] ** 2 * inertia
    for other, (joint, model) in enumerate(zip(machine.joints, joints, strict=True)):
        stiffness[:, other, other] += s * model.viscosity * mass[other]
        if other != axis:
            whole = PartialFractions.of(model.viscosity, np.inf, mode_rows(model.modes)).at(s)
            swing = whole * s * (s + model.viscosity)  # H, what the encoder sees of the carriage
            stiffness[:, other, other] += drive * control[joint].response(z, machine.sample_time) * swing
    alone = mass[axis] * s * (s + joints[axis].viscosity)
    return alone * np.linalg.inv(stiffness)[:, axis, axis]
