"""Safe stops of the machine and the reset; the test replaces the joint controllers."""

import math
import re

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

from pkm_interfaces.msg import CycleEvent, EncoderSample
from pkm_nodes.nodes.machine import BRAKE_TICKS, MachineNode
from support.controllers import IN_TIME


def test_joint_that_answers_nan_is_named_with_its_voltage(graph, controllers):
    graph.start(MachineNode, answer_timeout=IN_TIME)
    controllers.load(1, 10)
    controllers.wait_for(0)
    controllers.answer(0, joints=['d1', 'd3', 'd5'])
    controllers.answer(0, math.nan, joints=['d7'])
    message = graph.next_event(CycleEvent.FAULT).message
    assert message.endswith('from joint_controller of d7 (/pkm/test, answered with nan V; expected a finite voltage)')


def test_missing_answers_stop_the_machine_and_name_the_joints(graph, controllers):
    graph.start(MachineNode, answer_timeout=IN_TIME)
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
    controllers.load(1, 10)
    controllers.run(0, 4)
    controllers.wait_for(4)
    controllers.answer(4, joints=['d1', 'd5'])

    fault = graph.next_event(CycleEvent.FAULT)
    assert (fault.source, fault.cycle, fault.samples) == ('machine', 1, 4)
    assert re.match(r'tick 4 \(cycle 1, sample 4\): no answer for \d+\.\d s from ', fault.message)
    assert fault.message.endswith('joint_controller of d3 (/pkm/test), joint_controller of d7 (/pkm/test)')
    assert fault.tick == 5 + BRAKE_TICKS
    controllers.wait_for(fault.tick - 1, EncoderSample.SAFE_STOP)
    for heard in controllers.samples.values():
        assert [s.tick for s in heard] == list(range(fault.tick))
        assert [s.mode for s in heard] == [EncoderSample.RUN] * 5 + [EncoderSample.SAFE_STOP] * BRAKE_TICKS
    graph.spin_until(
        lambda: diagnostics and fault.message in diagnostics[-1].status[0].message, 'the fault in the diagnostics'
    )


def test_after_a_safe_stop_cycles_are_refused_until_reset(graph, controllers, machine):
    graph.start(MachineNode, answer_timeout=IN_TIME)
    controllers.load(1, 10)
    fault = graph.next_event(CycleEvent.FAULT)
    controllers.wait_for(fault.tick - 1, EncoderSample.SAFE_STOP)

    controllers.load(2, 3)
    refused = graph.next_event(CycleEvent.REFUSED)
    assert refused.cycle == 2
    assert fault.message in refused.message
    assert 'call the service machine/reset first' in refused.message

    response = graph.call(Trigger, 'machine/reset')
    assert response.success
    assert response.message == f'at home; cleared: {fault.message}'
    graph.next_event(CycleEvent.RESET)
    controllers.load(3, 3)
    graph.next_event(CycleEvent.STARTED, cycle=3)
    controllers.wait_for(fault.tick)
    for home, heard in zip(machine.home, controllers.samples.values(), strict=True):
        assert heard[-1].position == pytest.approx(home, abs=machine.encoder_resolution)
    controllers.run(fault.tick, 3)
    graph.next_event(CycleEvent.FINISHED, cycle=3)


def test_answers_that_come_after_a_safe_stop_are_not_applied(graph, controllers):
    graph.start(MachineNode, answer_timeout=0.2)
    controllers.load(1, 10)
    fault = graph.next_event(CycleEvent.FAULT)
    controllers.answer(fault.tick, 10.0)
    graph.spin_in_silence()
    controllers.wait_for(fault.tick - 1, EncoderSample.SAFE_STOP)


def test_reset_is_refused_while_a_cycle_runs(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 10)
    graph.next_event(CycleEvent.STARTED)
    response = graph.call(Trigger, 'machine/reset')
    assert not response.success
    assert response.message == 'cycle 1 is running; reset is allowed only between cycles'
    controllers.run(0, 10)
    graph.next_event(CycleEvent.FINISHED)


def test_carriage_at_its_mechanical_stop_is_a_fault(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 1000)
    samples, answered = controllers.samples['d7'], 0
    while not samples or samples[-1].mode == EncoderSample.RUN:
        controllers.wait_for(answered)
        controllers.answer(answered, 10.0)
        answered += 1
        graph.spin_until(lambda t=answered: samples[-1].tick >= t, f'a sample of tick {answered}')
    fault = graph.next_event(CycleEvent.FAULT)
    assert re.search(r'd\d ran into its upper stop at .* mm; travel is', fault.message)
    assert fault.samples == answered
    controllers.wait_for(fault.tick - 1, EncoderSample.SAFE_STOP)
    for heard in controllers.samples.values():
        assert [s.tick for s in heard] == list(range(fault.tick))
        assert {s.mode for s in heard[:answered]} == {EncoderSample.RUN}
        assert {s.mode for s in heard[answered:]} == {EncoderSample.SAFE_STOP}
        last = [s.counts for s in heard[-20:]]
        assert max(last) - min(last) <= 5, 'at standstill except for encoder noise: 1 um in 10 ms'


def test_stop_service_brakes_the_running_cycle_at_once(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 1000)
    controllers.run(0, 30, volts=0.5)
    answer = graph.call(Trigger, 'machine/stop')
    assert answer.success
    assert answer.message.startswith('the machine was stopped at tick ')
    fault = graph.next_event(CycleEvent.FAULT)
    assert (fault.cycle, fault.message) == (1, 'stopped by the service machine/stop')
    assert 'had stopped already' in graph.call(Trigger, 'machine/stop').message
    assert graph.call(Trigger, 'machine/reset').success


def test_no_cycle_starts_after_a_stop_between_cycles(graph, controllers):
    graph.start(MachineNode)
    assert graph.call(Trigger, 'machine/stop').success
    controllers.load(1, 10)
    assert 'stopped by the service machine/stop' in graph.next_event(CycleEvent.REFUSED, cycle=1).message
    assert graph.call(Trigger, 'machine/reset').success
    controllers.load(2, 10)
    graph.next_event(CycleEvent.STARTED, cycle=2)
