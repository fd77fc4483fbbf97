"""
Controllers of a whole machine, all joints at once: what `simulation` and the nodes that own every axis drive.

A controller has ``load(trajectory, learned)`` (a `SampledTrajectory` in joints and (N, n) volts), then once a tick
``update(index, measured) -> (voltage, error)`` with arrays (n,), and ``reset()``.
"""

import numpy as np

from pkm_core.config import read_yaml
from pkm_core.control.computed_torque import ComputedTorque, TorqueGains, load_torque_control
from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController, load_control
from pkm_core.errors import ConfigError

KINDS = {'robust': ('control', load_control), 'computed_torque': ('control/computed_torque', load_torque_control)}


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
    law = ComputedTorque if kind_of(control) == 'computed_torque' else JointControllers
    return law(machine, control, load_model(machine))


def kind_of(control):
    """Return which of `KINDS` the gains `control`, {joint: gains}, are for."""
    return 'computed_torque' if isinstance(next(iter(control.values())), TorqueGains) else 'robust'


def find_control(machine, chosen='robust'):
    """
    Return (kind, path) of a choice of controller.

    `chosen` is one of `KINDS`, which takes the machine's own gains, or the name of a file of config/control or
    config/control/computed_torque, or a YAML file of gains, which itself tells for which controller it is.

    Raises
    ------
    ConfigError
        If there is no such file; what there is is listed.

    """
    if chosen in KINDS:
        return chosen, machine.configuration.find(KINDS[chosen][0], machine.name)
    failures = []
    for folder, _ in KINDS.values():
        try:
            path = machine.configuration.find(folder, chosen)
        except ConfigError as error:
            failures.append(str(error))
            continue
        joints = read_yaml(path).get('joints')
        gains = joints.values() if isinstance(joints, dict) else ()
        torque = any(isinstance(each, dict) and 'natural_frequency' in each for each in gains)
        return ('computed_torque' if torque else 'robust'), path
    reasons = '; '.join(dict.fromkeys(failures))
    raise ConfigError(f'control {chosen!r} is none of {list(KINDS)}; {reasons}')


def choose_control(machine, chosen='robust'):
    """Return {joint: gains} of a choice as `find_control` takes it; refusals also as `load_control`."""
    kind, path = find_control(machine, chosen)
    return KINDS[kind][1](machine, path)
