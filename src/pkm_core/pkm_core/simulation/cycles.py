"""
The whole loop without ROS: the objects of the nodes, called in the order of the nodes, and therefore the same bits.

One cycle: start the plant's cycle; per tick counts -> position -> controllers -> voltages -> plant. After the last tick
the monitor of each joint checks the cycle; unless it intervenes, the law computes the next cycle's feedforward from the
error and the feedforward. A laser may measure the end point. It acts on the loop only through learning at the tool,
which corrects the reference of the next cycle.
"""

from dataclasses import dataclass, replace

import numpy as np

from pkm_core.control.controllers import JointControllers, make_controller
from pkm_core.control.feasibility import saturation_notice
from pkm_core.control.model import load_model
from pkm_core.errors import PkmError
from pkm_core.learning.monitor import LEARNED, Monitor
from pkm_core.motion.metrics import AxisMetrics, axis_metrics
from pkm_core.motion.trajectory import AT_HOME
from pkm_core.plant.laser import Laser, LaserSamples
from pkm_core.plant.plant import Plant
from pkm_core.simulation.compiled import run_cycle


@dataclass(frozen=True)
class CycleRecords:
    """All signals of a run, per cycle, sample and joint."""

    joints: tuple[str, ...]
    error: np.ndarray  # (cycles, N, n) [m] reference minus measured
    counts: np.ndarray  # (cycles, N, n) int64
    voltage: np.ndarray  # (cycles, N, n) [V]
    feedforward: np.ndarray  # (cycles, N, n) [V] the learned part, before the filters
    correction: np.ndarray  # (cycles, N, n) [m] of the reference, learned at the tool
    metrics: tuple[tuple[AxisMetrics, ...], ...]  # [cycle][joint]
    notices: tuple[str, ...]  # of saturated drives and of the learning monitors, in order
    laser: tuple[LaserSamples, ...]  # [cycle] of the end point; empty without a laser
    truth: tuple[np.ndarray, ...]  # [cycle] (N, m) true displacement of the end point [m, rad]; as `laser`; to judge
    temperatures: tuple[dict, ...]  # [cycle] of the plant, over ambient, by node [K]; {} without heat; to judge

    def metric(self, name):
        """Return the field `name` of `AxisMetrics` as an array (cycles, n)."""
        return np.array([[getattr(axis, name) for axis in cycle] for cycle in self.metrics])


def run_cycles(
    machine,
    trajectory,
    gains,
    law,
    cycles,
    seed,
    environment='nominal',
    start=None,
    laser=False,
    controller=None,
    tool=None,
    rise=None,
    pauses=None,
):
    """
    Run `cycles` cycles of a joint trajectory from power-up at the home position.

    Parameters
    ----------
    machine : Machine
        The simulated machine.
    trajectory : SampledTrajectory
        In joints, as `to_joints` returns it; N samples.
    gains : dict of str to RobustGains or TorqueGains
        From `load_control` or `load_torque_control`.
    law : Law or None
        From `make_law`; None learns nothing.
    cycles : int
        Number of cycles.
    seed, environment : int, str
        Of the plant.
    start : ndarray, shape (N, n), optional
        Learned feedforward [V] of the first cycle, by default zero; without a law that of all cycles.
    laser : bool
        Whether the end point is measured; doubles the run time.
    controller : object, optional
        With the interface of pkm_core.control.controllers; replaces the controller that `gains` describes.
    tool : ToolLearning, optional
        Learns at the tool from the laser, for the same trajectory; new for every run. It needs the laser.
    rise : array_like, optional
        Temperatures of the plant at power-up, see `Plant`.
    pauses : array_like, shape (cycles - 1,), optional
        Time [s] between each cycle and the next one, during which the machine repeats the first of them. Only its
        temperatures change, with the mean losses of that cycle; nothing is learned.

    Returns
    -------
    records : CycleRecords

    Raises
    ------
    PkmError
        If the plant stops with a fault; with cycle and sample.

    """
    if cycles > 1 and np.abs(trajectory.position[-1] - trajectory.position[0]).max() > AT_HOME:
        raise PkmError(f'cycles: {cycles} of a motion that ends elsewhere than where it begins; allowed: 1')
    plant = Plant(machine, seed, environment, rise)
    controller = make_controller(machine, gains) if controller is None else controller
    records = _empty_records(machine, cycles, trajectory, start)
    learning = None if law is None else _Learning(machine, law.with_reference(trajectory), given=start is not None)
    watch = Laser(machine, seed, environment) if laser or tool else None
    if watch:
        watch.zero(0, plant.truth)
    metrics, notices, seen, truths, temperatures = [], [], [], [], []
    for cycle in range(cycles):
        error, feedforward = records.error[cycle], records.feedforward[cycle]
        controller.load(tool.reference if tool else trajectory, feedforward)
        records.correction[cycle] = tool.correction if tool else 0.0
        if pauses is not None and cycle:
            plant.pass_time(pauses[cycle - 1], repeating=True)
        plant.start_cycle(cycle + 1)  # the cell counts cycles from 1
        temperatures.append(plant.temperatures)
        rows = records.counts[cycle], records.voltage[cycle], error
        if watch is None and isinstance(controller, JointControllers):
            done = run_cycle(plant, controller, *rows)
        else:
            done = _run_cycle(plant, controller, *rows, watch, cycle * len(trajectory) + 1)
        if plant.fault:
            raise PkmError(f'cycle {cycle + 1}, sample {done - 1}: {plant.fault}')
        if watch:
            samples, true = watch.read_with_truth()
            seen.append(samples)
            truths.append(true)
        moves = trajectory.move_starts, trajectory.move_ends, machine.sample_time
        metrics.append(tuple(axis_metrics(axis_error, *moves) for axis_error in error.T))
        notices += [f'cycle {cycle + 1}: {message}' for message in _saturated(machine, records.voltage[cycle])]
        if learning is not None and cycle + 1 < cycles:
            records.feedforward[cycle + 1], messages = learning.after_cycle(error, feedforward)
            notices += [f'cycle {cycle + 1}: {message}' for message in messages]
        if tool and (message := tool.after_cycle(error, cycle * len(trajectory), *seen[-1])):
            notices.append(f'cycle {cycle + 1}: {message}')
    return replace(
        records,
        metrics=tuple(metrics),
        notices=tuple(notices),
        laser=tuple(seen),
        truth=tuple(truths),
        temperatures=tuple(temperatures),
    )


def _empty_records(machine, cycles, trajectory, start):
    """Return `CycleRecords` of zeros, with the feedforward `start` in every cycle if it is not None."""
    shape = (cycles, *trajectory.position.shape)
    error, voltage, feedforward, correction = (np.zeros(shape) for _ in range(4))
    if start is not None:
        feedforward[:] = start
    counts = np.zeros(shape, dtype=np.int64)
    return CycleRecords(machine.joints, error, counts, voltage, feedforward, correction, (), (), (), (), ())


def _saturated(machine, voltage):
    """Yield the notice of every joint whose command (N,) of `voltage` (N, n) was at its limit."""
    at_limit = np.count_nonzero(np.abs(voltage) >= machine.voltage_limit, axis=0)
    for joint, samples in zip(machine.joints, at_limit.tolist(), strict=True):
        if samples:
            yield saturation_notice(joint, samples, len(voltage), machine.voltage_limit)


class _Learning:
    """
    A law and one `Monitor` per joint, between two cycles.

    The first cycle after power-up differs by its friction, which does not repeat. Nothing is learned from it under a
    `given` feedforward, learned in steady repetition, or with identified forces, which leave little but that friction.
    """

    def __init__(self, machine, law, *, given):
        self._joints, self._sample_time, self._law = machine.joints, machine.sample_time, law
        self._monitors = [Monitor(joint, LEARNED if given else 0) for joint in machine.joints]
        models = load_model(machine)
        self._one_offs = {joint for joint in machine.joints if given or models[joint].forces is not None}

    def after_cycle(self, error, feedforward):
        """
        Return the feedforward of the next cycle and the messages of the monitors.

        `error` [m] and `feedforward` [V] are those of the cycle, (N, n), and so is the feedforward returned.
        """
        following, messages = np.empty_like(feedforward), []
        for axis, (joint, monitor) in enumerate(zip(self._joints, self._monitors, strict=True)):
            if joint in self._one_offs:
                following[:, axis] = feedforward[:, axis]
                continue
            decision = monitor.observe(error[:, axis], feedforward[:, axis])
            learned = decision.feedforward
            if decision.learn:
                learned = self._law.update(joint, error[:, axis], learned, decision.iteration, self._sample_time)
            if decision.message:
                messages.append(decision.message)
            following[:, axis] = learned
        self._one_offs = set()
        return following, messages


def _run_cycle(plant, controller, counts, voltage, error, watch, first):
    """
    Run one cycle tick by tick, as `compiled.run_cycle` does, with any controller; return the number of ticks.

    A laser `watch` that is not None measures every tick, counted from `first`.
    """
    for index in range(len(counts)):
        counts[index] = plant.counts
        voltage[index], error[index] = controller.update(index, counts[index] * plant.machine.encoder_resolution)
        plant.tick(voltage[index])
        if watch:
            watch.observe(first + index, plant.truth)
        if plant.fault:
            return index + 1
    return len(counts)
