"""
The whole loop without ROS: the objects of the nodes, called in the order of the nodes, so with the same bits.

A cycle: start the plant's cycle, then tick by tick counts -> position -> controllers -> voltages -> plant; after its
last tick every joint's law turns error and feedforward into the feedforward of the next cycle.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController
from pkm_core.errors import PkmError
from pkm_core.metrics import AxisMetrics, axis_metrics
from pkm_core.plant import Plant


@dataclass(frozen=True)
class CycleRecords:
    """What happened, per cycle, sample and joint."""

    joints: tuple[str, ...]
    error: np.ndarray  # (cycles, N, n) [m] r - y
    counts: np.ndarray  # (cycles, N, n) int64
    voltage: np.ndarray  # (cycles, N, n) [V]
    feedforward: np.ndarray  # (cycles, N, n) [V] the learned part, before the filters
    metrics: tuple[tuple[AxisMetrics, ...], ...]  # [cycle][joint]

    def metric(self, name):
        """Return the field `name` of `AxisMetrics` as an array (cycles, n)."""
        return np.array([[getattr(axis, name) for axis in cycle] for cycle in self.metrics])


def run_cycles(machine, trajectory, control, law, cycles, seed, environment='nominal'):
    """
    Run `cycles` cycles of a joint trajectory, from power-up at home, and return their `CycleRecords`.

    `trajectory` is in joints, as `to_joints` returns it; `control` comes from `load_control`, `law` from `make_law`, or
    None to learn nothing; `seed` and `environment` go to the plant.

    Raises
    ------
    PkmError
        If the plant stops with a fault; cycle and sample are named.

    """
    plant = Plant(machine, seed, environment)
    models = load_model(machine)
    controllers = [
        RobustController(control[joint], models[joint], machine.sample_time, machine.voltage_limit)
        for joint in machine.joints
    ]
    shape = (cycles, *trajectory.position.shape)
    error, voltage, feedforward = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    counts = np.zeros(shape, dtype=np.int64)
    metrics = []
    for cycle in range(cycles):
        for axis, controller in enumerate(controllers):
            reference = (derivative[:, axis] for derivative in trajectory.derivatives())
            controller.load(*reference, feedforward[cycle, :, axis])
        plant.start_cycle(cycle + 1)  # the cell counts cycles from 1
        for index in range(len(trajectory)):
            counts[cycle, index] = plant.counts
            for axis, controller in enumerate(controllers):
                measured = float(counts[cycle, index, axis] * machine.encoder_resolution)
                voltage[cycle, index, axis], error[cycle, index, axis] = controller.update(index, measured)
            plant.tick(voltage[cycle, index])
            if plant.fault:
                raise PkmError(f'cycle {cycle + 1}, sample {index}: {plant.fault}')
        metrics.append(
            tuple(
                axis_metrics(axis_error, trajectory.move_starts, trajectory.move_ends, machine.sample_time)
                for axis_error in error[cycle].T
            )
        )
        if law is not None and cycle + 1 < cycles:
            for axis, joint in enumerate(machine.joints):
                feedforward[cycle + 1, :, axis] = law.update(
                    joint, error[cycle, :, axis], feedforward[cycle, :, axis], cycle, machine.sample_time
                )
    return CycleRecords(machine.joints, error, counts, voltage, feedforward, tuple(metrics))
