"""The compiled cycle compared with the same objects called tick by tick."""

import numpy as np
import pytest

from pkm_core.control.controllers import choose_control, make_controller
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.plant import Plant
from pkm_core.simulation.compiled import run_cycle

MACHINE = load_machine('four_dof')
JOINTS = len(MACHINE.joints)
RECORDS = (('counts', np.int64), ('voltage', float), ('error', float))


@pytest.fixture(scope='module')
def trajectory():
    """Return a trajectory that is longer than a block of noise."""
    trajectory = to_joints(MACHINE, plan(MACHINE, load_motion('four_dof_path')))
    assert len(trajectory) > 1024
    return trajectory


class Loop:
    """A plant with its controllers after one cycle, compiled or tick by tick."""

    def __init__(self, trajectory, *, compiled, learned=0.0, control='robust'):
        self.plant = Plant(MACHINE, 3)
        self.controller = make_controller(MACHINE, choose_control(MACHINE, control))
        self.trajectory, self.compiled = trajectory, compiled
        self.run(learned)

    def run(self, learned=0.0):
        """Run the next cycle and return its number of samples."""
        samples = len(self.trajectory)
        feedforward = np.full((samples, JOINTS), learned)
        feedforward[:50] = 0.0  # the feedforward starts with a step, which the integrator takes up
        self.controller.load(self.trajectory, feedforward)
        self.plant.start_cycle(1)
        self.counts, self.voltage, self.error = (np.zeros((samples, JOINTS), kind) for _, kind in RECORDS)
        self.samples = self._run_compiled() if self.compiled else self._run_ticks()

    def _run_compiled(self):
        return run_cycle(self.plant, self.controller, self.counts, self.voltage, self.error)

    def _run_ticks(self):
        for index in range(len(self.counts)):
            self.counts[index] = self.plant.counts
            measured = self.counts[index] * MACHINE.encoder_resolution
            self.voltage[index], self.error[index] = self.controller.update(index, measured)
            self.plant.tick(self.voltage[index])
            if self.plant.fault:
                return index + 1
        return len(self.counts)


def assert_same_bits(one, other):
    for name, _ in RECORDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.plant.truth.q, other.plant.truth.q)
    assert one.plant.truth.time == other.plant.truth.time
    assert one.samples == other.samples


@pytest.mark.parametrize('control', ['robust', 'observer'])
def test_compiled_cycles_give_the_bits_of_single_ticks(trajectory, control):
    """Both cycles of two."""
    compiled, ticks = (Loop(trajectory, compiled=each, control=control) for each in (True, False))
    assert compiled.samples == len(trajectory)
    assert_same_bits(compiled, ticks)
    compiled.run()
    ticks.run()
    assert_same_bits(compiled, ticks)


def test_single_ticks_continue_after_a_compiled_cycle(trajectory):
    compiled, ticks = Loop(trajectory, compiled=True), Loop(trajectory, compiled=False)
    compiled.compiled = False
    compiled.run()
    ticks.run()
    assert_same_bits(compiled, ticks)


def test_fault_ends_both_at_the_same_sample_with_the_same_text(trajectory):
    compiled, ticks = (Loop(trajectory, compiled=kind, learned=300.0) for kind in (True, False))
    assert 0 < compiled.samples < len(trajectory)
    assert compiled.plant.fault == ticks.plant.fault
    assert_same_bits(compiled, ticks)


def test_voltage_that_is_not_finite_is_refused_with_its_tick():
    plant = Plant(MACHINE, 3)
    volts = np.zeros((2, JOINTS))
    volts[1, 2] = np.nan

    def loop(arguments, counts, noise, row, substeps, index, stop):
        from pkm_core.plant.tick import advance

        while index < stop:
            event = advance(*arguments, volts[index], noise, row + index, substeps, False)
            index += 1
            if event:
                return index, event
        return index, 0

    with pytest.raises(PkmError, match='tick 1 of the loop: a voltage is not finite'):
        plant.run(loop, 2)
