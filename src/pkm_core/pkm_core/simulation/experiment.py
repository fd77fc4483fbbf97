"""Identification experiments on the simulated machine without ROS; the excitation is added after the controllers."""

import numpy as np

from pkm_core.control.controllers import make_controller
from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import JointRecord
from pkm_core.identification.guard import Guard
from pkm_core.plant.plant import Plant

_BRAKE_TICKS = 1000  # 0.5 s; the shorted motors stop 1 kg from the speed limit within 0.1 s


class SimulatedCell:
    """
    A simulated machine under its controllers that runs experiments, cycle after cycle.

    Parameters
    ----------
    machine : Machine
        The simulated machine.
    gains : dict of str to RobustGains
        From `load_control`.
    seed, environment : int, str
        Of the plant.

    """

    def __init__(self, machine, gains, seed, environment='nominal'):
        self._machine = machine
        self._plant = Plant(machine, seed, environment)
        self._controllers = make_controller(machine, gains)
        self._cycle = 0

    def run(self, experiment):
        """
        Return the `JointRecord` of `experiment`.

        Raises
        ------
        IdentificationError
            If a bound of the experiment is exceeded or the machine has a fault; it is braked to a standstill first.

        """
        machine, plant, trajectory = self._machine, self._plant, experiment.trajectory
        axis = machine.joints.index(experiment.joint)
        guard = Guard(experiment.joint, experiment.bounds, machine.sample_time)
        shape = trajectory.position.shape
        counts, voltage = np.zeros(shape, dtype=np.int64), np.zeros(shape)
        self._controllers.load(trajectory, np.zeros(shape))
        self._cycle += 1
        plant.start_cycle(self._cycle)
        for index in range(len(trajectory)):
            counts[index] = plant.counts
            position = counts[index] * machine.encoder_resolution
            volts, _ = self._controllers.update(index, position)
            volts = np.clip(volts + experiment.excitation[index], -machine.voltage_limit, machine.voltage_limit)
            reason = guard.check(index, volts[axis], position[axis], trajectory.position[index, axis]) or plant.fault
            if reason:
                self._stop()
                raise IdentificationError(f'{experiment.name}: {reason}; the machine was braked to a standstill')
            voltage[index] = volts
            plant.tick(volts)
        moves = tuple(zip(trajectory.move_starts.tolist(), trajectory.move_ends.tolist(), strict=True))
        excitation = experiment.excitation if experiment.excitation.any() else None
        return JointRecord(experiment.name, trajectory.position, counts, voltage, excitation, moves)

    def _stop(self):
        for _ in self._plant.brake(_BRAKE_TICKS):
            pass
        self._controllers.reset()
