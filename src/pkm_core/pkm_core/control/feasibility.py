"""
Whether a drive can follow a motion by the model of its axis, and the notice of a drive at its limit.

The check of `motion.trajectory` uses the masses of the nominal design. The identified gain K gives the whole moved
mass, which is larger, and with it the voltage: (qdd + a qd)/K + coupling, and with `forces` friction and ripple.
"""

import numpy as np

from pkm_core.control.forces import CycleForces, coupling_voltage
from pkm_core.errors import TrajectoryError


def needed_voltage(machine, model, trajectory, column):
    """Return the voltage (N,) [V] that moves the joint in `column` along a trajectory in joints, by its `AxisModel`."""
    position, velocity, acceleration = (rows[:, column] for rows in trajectory.derivatives()[:3])
    coupling = coupling_voltage(machine, trajectory, column)
    if model.forces is not None:
        return CycleForces(position, velocity, acceleration, coupling, 0.0).voltage(model)
    return (acceleration + model.viscosity * velocity) / model.gain + coupling


def check_drive(machine, model, trajectory, column):
    """
    Refuse a trajectory in joints that the drive of the joint in `column` cannot follow by its `AxisModel`.

    Raises
    ------
    TrajectoryError
        With joint, sample, needed and allowed voltage.

    """
    size, limit = np.abs(needed_voltage(machine, model, trajectory, column)), machine.drive_limit
    sample = int(np.argmax(size))
    if not size[sample] <= limit:
        raise TrajectoryError(
            f'trajectory: {machine.joints[column]} at sample {sample} needs {size[sample]:.1f} V by its model; allowed '
            f'{limit:g} V'
        )


def drive_check(machine, models):
    """Return the function that refuses a trajectory in joints by `check_drive` of every joint, for `plan`."""

    def check(trajectory):
        for column, joint in enumerate(machine.joints):
            check_drive(machine, models[joint], trajectory, column)

    return check


def saturation_notice(joint, samples, total, limit):
    """Return the notice of `samples` of `total` in a cycle with the command at its limit [V]; '' if there are none."""
    if not samples:
        return ''
    return f'{joint}: {samples} of {total} samples at the limit of {limit:g} V; the axis did not follow its command'
