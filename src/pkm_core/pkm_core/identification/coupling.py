"""
Effect of the other axes on one axis, from the design of the machine. It gives K_i the same meaning in every experiment.

K_i is the acceleration of axis i per volt with the machine at home and the other axes held. The masses of
config/machines only correct for other positions and moving axes, a few per cent of the whole.
"""

import numpy as np

from pkm_core.identification.partial_fractions import PartialFractions, mode_rows


def reaction_voltage(machine, reference, axis):
    """
    Return the voltage (N,) of joint number `axis` that does not accelerate its own inertia at home.

    It is (M qdd + C + G)_i - M_ii(home) qdd_i divided by the thrust per volt, along the `reference` (N, n) of all
    joints [m].
    """
    velocity = np.gradient(reference, machine.sample_time, axis=0)
    acceleration = np.gradient(velocity, machine.sample_time, axis=0)
    force = machine.inverse_dynamics(reference, velocity, acceleration)[:, axis]
    own = machine.mass_matrix(machine.home)[axis, axis] * acceleration[:, axis]
    return (force - own) / machine.thrust_per_volt


def coupling_factor(machine, axis, position, frequency, models, gains):
    """
    Return the response (F,) of joint number `axis` over its response with the other joints held at home.

    The excited axis moves the others through the off-diagonal masses at `position` (n,) [m]. Below the bandwidth of
    their loops the others are held; above it they float, which lowers the effective mass of the axis. Series modes
    cancel.

    `frequency` (F,) is in Hz; `models` and `gains` are those of all joints.
    """
    s = 2j * np.pi * frequency
    z = np.exp(s * machine.sample_time)
    drive = machine.thrust_per_volt * np.exp(-1.5 * s * machine.sample_time)  # with computation and hold
    design = machine.mass_matrix(np.stack([machine.home, position]))
    joints = [models[joint] for joint in machine.joints]
    mass = machine.thrust_per_volt / np.array([model.gain for model in joints])  # at home, as identified
    inertia = design[1] + np.diag(mass - np.diag(design[0]))
    stiffness = s[:, np.newaxis, np.newaxis] ** 2 * inertia
    for other, (joint, model) in enumerate(zip(machine.joints, joints, strict=True)):
        stiffness[:, other, other] += s * model.viscosity * mass[other]
        if other != axis:
            whole = PartialFractions.of(model.viscosity, np.inf, mode_rows(model.modes)).at(s)
            swing = whole * s * (s + model.viscosity)  # H, from the carriage to the encoder
            stiffness[:, other, other] += drive * gains[joint].response(z, machine.sample_time) * swing
    alone = mass[axis] * s * (s + joints[axis].viscosity)
    return alone * np.linalg.inv(stiffness)[:, axis, axis]
