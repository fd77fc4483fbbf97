"""Laser samples of the machine and their times; the test replaces the joint controllers."""

import numpy as np
import pytest
from std_srvs.srv import Trigger

from pkm_core.machines.laser_clock import sample_numbers
from pkm_interfaces.msg import CycleEvent, LaserSample
from pkm_nodes.nodes.machine import LASER_EVERY, MachineNode
from support.controllers import IN_TIME


def test_laser_samples_continue_over_two_cycles(graph, controllers, machine):
    graph.start(MachineNode)
    laser = graph.listen(LaserSample, 'laser')
    controllers.load(1, 30)
    controllers.run(0, LASER_EVERY, 0.5)
    controllers.wait_for(LASER_EVERY)
    told = len(sample_numbers(machine, 0, LASER_EVERY))
    graph.spin_until(lambda: len(laser) == told, 'the samples of the first ticks')
    controllers.run(LASER_EVERY, 30 - LASER_EVERY, 0.5)
    graph.next_event(CycleEvent.FINISHED)
    graph.spin_until(lambda: len(laser) == len(sample_numbers(machine, 0, 30)), 'the samples of the cycle')
    controllers.load(2, 30)
    controllers.run(30, 30)
    graph.next_event(CycleEvent.FINISHED, cycle=2)
    graph.spin_until(lambda: len(laser) == len(sample_numbers(machine, 0, 60)), 'those of the next cycle')
    assert [sample.time for sample in laser] == pytest.approx([0.8e-3 * k for k in range(len(laser))])
    assert {len(sample.displacement) for sample in laser} == {4}
    moved = machine.forward([s[-1].position for s in controllers.samples.values()]) - machine.forward(machine.home)
    assert np.abs(moved[:3]).max() > 20e-6
    # links and marks off by 10 um on 70 mm, and one sample of 0.8 ms
    assert list(laser[-1].displacement) == pytest.approx(moved.tolist(), abs=5e-6, rel=0.05)


def test_laser_measures_during_a_safe_stop_and_after_the_reset(graph, controllers, machine):
    graph.start(MachineNode, answer_timeout=IN_TIME)
    laser = graph.listen(LaserSample, 'laser')
    controllers.load(1, 30)
    controllers.run(0, 10, 1.0)
    fault = graph.next_event(CycleEvent.FAULT)
    graph.spin_until(lambda: len(laser) == len(sample_numbers(machine, 0, fault.tick)), 'the samples of the safe stop')
    assert abs(laser[-1].displacement[0]) > 5e-6
    graph.call(Trigger, 'machine/reset')
    controllers.load(2, 10)
    controllers.run(fault.tick, 10)
    graph.next_event(CycleEvent.FINISHED)
    end = fault.tick + 10
    graph.spin_until(lambda: len(laser) == len(sample_numbers(machine, 0, end)), 'the samples after the reset')
    assert [sample.time for sample in laser] == pytest.approx([0.8e-3 * k for k in range(len(laser))])
    assert abs(laser[-1].displacement[0]) < 3e-6
