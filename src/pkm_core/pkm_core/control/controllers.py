"""
Controllers of a whole machine, all joints at once; used by `simulation` and by nodes that control all axes.

A controller has ``load(trajectory, learned)`` (a `SampledTrajectory` in joints and (N, n) volts), then once per tick
``update(index, measured) -> (voltage, error)`` with arrays (n,), and ``reset()``.
"""

import numpy as np

from pkm_core.config import read_yaml
from pkm_core.config_errors import short
from pkm_core.control.computed_torque import ComputedTorque, TorqueGains, load_torque_control
from pkm_core.control.feasibility import drive_check
from pkm_core.control.forces import coupling_voltage
from pkm_core.control.model import load_model
from pkm_core.control.observer import ObserverController, load_observer
from pkm_core.control.observer_design import ObserverLaw
from pkm_core.control.robust import RobustController, load_control
from pkm_core.errors import ConfigError

KINDS = {
    'robust': ('control', load_control),
    'computed_torque': ('control/computed_torque', load_torque_control),
    'observer': ('control/observer', load_observer),
}
SINGLE_AXIS = ('robust', 'observer')  # kinds with one controller per joint, which learn
# a key that only gains of the kind have; without it they are robust
_KEYS = {'natural_frequency': 'computed_torque', 'effort': 'observer'}


def axis_controller(gains, model, machine):
    """Return the controller of one axis for an `AxisLaw`: `RobustController` or `ObserverController`."""
    law = ObserverController if isinstance(gains, ObserverLaw) else RobustController
    return law(gains, model, machine.sample_time, machine.voltage_limit)


class JointControllers:
    """One independent `AxisController` per joint."""

    def __init__(self, machine, gains, models):
        self._machine, self._check = machine, drive_check(machine, models)
        self.axes = [axis_controller(gains[joint], models[joint], machine) for joint in machine.joints]

    def reset(self):
        """Return to the initial state, see `AxisController.reset`."""
        for axis in self.axes:
            axis.reset()

    def load(self, trajectory, learned):
        """Load a cycle, see `AxisController.load`; `TrajectoryError` if a drive cannot follow it by its model."""
        self._check(trajectory)
        for column, axis in enumerate(self.axes):
            coupling = coupling_voltage(self._machine, trajectory, column)
            axis.load(*(rows[:, column] for rows in trajectory.derivatives()), learned[:, column], coupling)

    def update(self, index, measured):
        """Return voltages [V] and errors [m], (n,) each, see `AxisController.update`."""
        steps = [axis.update(index, float(position)) for axis, position in zip(self.axes, measured, strict=True)]
        voltage, error = np.array(steps).T
        return voltage, error


def make_controller(machine, gains):
    """Return the controller for `gains` of one of `KINDS`, with the machine's models."""
    law = ComputedTorque if kind_of(gains) == 'computed_torque' else JointControllers
    return law(machine, gains, load_model(machine))


def kind_of(gains):
    """Return the key of `KINDS` for `gains`, {joint: RobustGains, TorqueGains or ObserverLaw}."""
    axis = next(iter(gains.values()))
    if isinstance(axis, TorqueGains):
        return 'computed_torque'
    return 'observer' if isinstance(axis, ObserverLaw) else 'robust'


def find_control(machine, chosen='robust'):
    """
    Return (kind, path) of a choice of controller.

    `chosen` is one of `KINDS` (the machine's own gains), the name of a file of config/control or of a folder in it, or
    the path of a YAML file of gains, whose keys determine the kind.

    Raises
    ------
    ConfigError
        If there is no such file; the existing names are listed.

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
        keys = {key for axis in gains if isinstance(axis, dict) for key in axis}
        return next((kind for key, kind in _KEYS.items() if key in keys), 'robust'), path
    reasons = '; '.join(dict.fromkeys(failures))
    raise ConfigError(
        f'control: {short(str(chosen))} given; allowed: {list(KINDS)}, a file of gains or its name; {reasons}'
    )


def choose_control(machine, chosen='robust'):
    """Return {joint: gains} for `chosen` of `find_control`; errors of `find_control` and `load_control`."""
    kind, path = find_control(machine, chosen)
    return KINDS[kind][1](machine, path)
