"""Subjects of the bench without ROS: the simulation of the whole cell, and MuJoCo with the mechanism alone."""

from time import perf_counter, process_time

from pkm_core.control.robust import load_control
from pkm_core.experiments.closed_chain import TICKS, MujocoChain, forces
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

LAW = 'fourier_pid'


def _timed(function):
    """Return the wall and the processor time [s] of one call."""
    wall, processor = perf_counter(), process_time()
    function()
    return perf_counter() - wall, process_time() - processor


class Simulation:
    """The cycles of the cell in `run_cycles`: same mathematics, same bits, no messages."""

    def __init__(self, machine_name):
        self._machine = load_machine(machine_name)
        self._gains = load_control(self._machine)
        self._law = make_law(LAW, self._machine, self._gains)
        motion = load_motion(default_motion(self._machine))
        self._trajectory = to_joints(self._machine, plan(self._machine, motion))
        self._run(2)  # warm

    def _run(self, cycles):
        return _timed(lambda: run_cycles(self._machine, self._trajectory, self._gains, self._law, cycles, seed=1))

    def turn(self, cycles):
        """Return ticks/s and processor time per tick of `cycles` learning cycles, including the set-up of the run."""
        ticks = cycles * len(self._trajectory)
        seconds, processor = self._run(cycles)
        return {'ticks_per_second': ticks / seconds, 'cpu_us_per_tick': 1e6 * processor / ticks}

    def close(self):
        """Nothing to close."""


class Mujoco:
    """
    The rigid mechanism in MuJoCo, with loops closed by constraints: no drives, no control, no messages.

    One RK4 step per tick, which keeps the path within 2 nm; test/bench/plant.py has the plant's integrator and others.
    """

    def __init__(self, machine_name):
        machine = load_machine(machine_name)
        self._force = forces(machine)
        self._chain = MujocoChain(machine, 'RK4', 1)
        self._chain.step(self._force)  # warm

    def turn(self, repetitions):
        """Return ticks/s and processor time per tick of `repetitions` runs of 70 ms."""
        ticks = repetitions * TICKS
        seconds, processor = _timed(lambda: [self._chain.step(self._force) for _ in range(repetitions)])
        return {'ticks_per_second': ticks / seconds, 'cpu_us_per_tick': 1e6 * processor / ticks}

    def close(self):
        """Nothing to close."""
