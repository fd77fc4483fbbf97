"""
Controllers of a whole machine, all joints at once: what `simulation` and the nodes that own every axis drive.

A controller has ``load(trajectory, learned)`` (a `SampledTrajectory` in joints and (N, n) volts), then once a tick
``update(index, measured) -> (voltage, error)`` with arrays (n,), and ``reset()``.
"""

import numpy as np

from pkm_core.control.computed_torque import ComputedTorque, TorqueGains
from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController


class JointControllers:
    """A `RobustController` on every joint; none knows of the others."""

    def __init__(self, machine, control, models):
        self.axes = [
            RobustController(control[joint], models[joint], machine.sample_time, machine.voltage_limit)
            for joint in machine.joints
        ]

    def reset(self):
        """Forget everything, see `RobustController.reset`."""
        for axis in self.axes:
            axis.reset()

    def load(self, trajectory, learned):
        """Take a cycle, see `RobustController.load`."""
        for column, axis in enumerate(self.axes):
            axis.load(*(rows[:, column] for rows in trajectory.derivatives()), learned[:, column])

    def update(self, index, measured):
        """Return voltages [V] and errors [m], (n,) each, see `RobustController.update`."""
        steps = [axis.update(index, float(position)) for axis, position in zip(self.axes, measured, strict=True)]
        voltage, error = np.array(steps).T
        return voltage, error


def make_controller(machine, control):
    """Return the controller for `control` of `load_control` or `load_torque_control`, with the machine's models."""
    law = ComputedTorque if isinstance(control[machine.joints[0]], TorqueGains) else JointControllers
    return law(machine, control, load_model(machine))
