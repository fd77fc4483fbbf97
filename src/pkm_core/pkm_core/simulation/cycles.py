"""
The whole loop without ROS: the objects of the nodes, called in the order of the nodes, so with the same bits.

A cycle: start the plant's cycle, then tick by tick counts -> position -> controllers -> voltages -> plant; after its
last tick every joint's monitor looks at it and, unless that steps in, the law turns error and feedforward into the
feedforward of the next cycle. A laser may watch the end point; the loop knows nothing of it.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.control.controllers import JointControllers, make_controller
from pkm_core.errors import PkmError
from pkm_core.learning.monitor import Monitor
from pkm_core.motion.metrics import AxisMetrics, axis_metrics
from pkm_core.plant.laser import Laser, LaserSamples
from pkm_core.plant.plant import Plant
from pkm_core.simulation.compiled import run_cycle


@dataclass(frozen=True)
class CycleRecords:
    """What happened, per cycle, sample and joint."""

    joints: tuple[str, ...]
    error: np.ndarray  # (cycles, N, n) [m] r - y
    counts: np.ndarray  # (cycles, N, n) int64
    voltage: np.ndarray  # (cycles, N, n) [V]
    feedforward: np.ndarray  # (cycles, N, n) [V] the learned part, before the filters
    metrics: tuple[tuple[AxisMetrics, ...], ...]  # [cycle][joint]
    notices: tuple[str, ...]  # what the monitors of learning noticed, in order
    laser: tuple[LaserSamples, ...]  # [cycle] of the end point; empty without a laser

    def metric(self, name):
        """Return the field `name` of `AxisMetrics` as an array (cycles, n)."""
        return np.array([[getattr(axis, name) for axis in cycle] for cycle in self.metrics])


def run_cycles(machine, trajectory, control, law, cycles, seed, environment='nominal', start=None, laser=False):
    """
    Run `cycles` cycles of a joint trajectory, from power-up at home, and return their `CycleRecords`.

    `trajectory` is in joints, as `to_joints` returns it; `control` comes from `load_control` or `load_torque_control`,
    `law` from `make_law`, or None to learn nothing; `seed` and `environment` go to the plant. `start` is the learned
    feedforward (N, n) [V] of the first cycle, by default none; without a law it stays. `laser`: whether the end
    point is measured, which takes as long again.

    Raises
    ------
    PkmError
        If the plant stops with a fault; cycle and sample are named.

    """
    plant = Plant(machine, seed, environment)
    controller = make_controller(machine, control)
    shape = (cycles, *trajectory.position.shape)
    error, voltage, feedforward = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    counts = np.zeros(shape, dtype=np.int64)
    if start is not None:
        feedforward[:] = start
    if law is not None:
        law = law.with_reference(trajectory)
    monitors = [Monitor(joint) for joint in machine.joints]
    metrics, notices = [], []
    watch, seen = Laser(machine, seed, environment) if laser else None, []
    if watch:
        watch.zero(0, plant.truth)
    for cycle in range(cycles):
        controller.load(trajectory, feedforward[cycle])
        plant.start_cycle(cycle + 1)  # the cell counts cycles from 1
        rows = counts[cycle], voltage[cycle], error[cycle]
        if watch is None and isinstance(controller, JointControllers):
            done = run_cycle(plant, controller, *rows)
        else:
            done = _run_cycle(plant, controller, *rows, watch, cycle * len(trajectory) + 1)
        if plant.fault:
            raise PkmError(f'cycle {cycle + 1}, sample {done - 1}: {plant.fault}')
        if watch:
            seen.append(watch.read())
        metrics.append(
            tuple(
                axis_metrics(axis_error, trajectory.move_starts, trajectory.move_ends, machine.sample_time)
                for axis_error in error[cycle].T
            )
        )
        if law is not None and cycle + 1 < cycles:
            for axis, joint in enumerate(machine.joints):
                decision = monitors[axis].observe(error[cycle, :, axis], feedforward[cycle, :, axis])
                learned = decision.feedforward
                if decision.learn:
                    learned = law.update(joint, error[cycle, :, axis], learned, decision.iteration, machine.sample_time)
                if decision.message:
                    notices.append(f'cycle {cycle + 1}: {decision.message}')
                feedforward[cycle + 1, :, axis] = learned
    return CycleRecords(
        machine.joints,
        error,
        counts,
        voltage,
        feedforward,
        tuple(metrics),
        tuple(notices),
        tuple(seen),
    )


def _run_cycle(plant, controller, counts, voltage, error, watch, first):
    """Do tick by tick what `closed_loop.run_cycle` does, with any controller; a laser watches from tick `first` on."""
    for index in range(len(counts)):
        counts[index] = plant.counts
        voltage[index], error[index] = controller.update(index, counts[index] * plant.machine.encoder_resolution)
        plant.tick(voltage[index])
        if watch:
            watch.observe(first + index, plant.truth)
        if plant.fault:
            return index + 1
    return len(counts)
