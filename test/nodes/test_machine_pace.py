"""Pace, pause and single steps of the machine; the test replaces the joint controllers."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from pkm_core.errors import PkmError
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.diagnostics import values_of
from pkm_nodes.nodes.machine import MachineNode
from support.controllers import IN_TIME

TICKS = 30


def set_pace(graph, value):
    """Set the parameter as a tool does; return whether it was taken, and why not."""
    request = SetParameters.Request(parameters=[Parameter('pace', value=value).to_parameter_msg()])
    (result,) = graph.call(SetParameters, 'machine/set_parameters', request).results
    return result.successful, result.reason


def pause(graph, on):
    response = graph.call(SetBool, 'machine/pause', SetBool.Request(data=on))
    assert response.success
    return response.message


def step(graph):
    response = graph.call(Trigger, 'machine/step')
    return response.success, response.message


def told(graph, heard):
    """Return the values of the next diagnostics of the machine, and its message for people."""
    heard.clear()
    graph.spin_until(lambda: heard, 'diagnostics')
    return values_of(heard[-1].status[0]), heard[-1].status[0].message


@pytest.fixture
def counts(graph, controllers):
    """Return a function that runs a cycle on a fresh machine and returns the counts."""

    def run(before_each_answer=lambda tick: None, **parameters):
        machine = graph.start(MachineNode, **parameters)
        controllers.load(1, TICKS)
        for tick in range(TICKS):
            controllers.wait_for(tick)
            before_each_answer(tick)
            controllers.answer(tick, 0.5)
        graph.next_event(CycleEvent.FINISHED)
        found = controllers.counts()
        for heard in controllers.samples.values():
            heard.clear()
        graph.stop(machine)
        return found

    return run


def test_pace_pause_and_steps_do_not_change_a_bit(graph, counts):
    def disturb(tick):
        if tick == 3:
            pause(graph, True)
        if 3 <= tick < 9:
            assert step(graph) == (True, f'tick {tick + 1} of cycle 1')
        elif tick == 9:
            set_pace(graph, 0.5)
            pause(graph, False)

    assert counts(disturb, pace=5.0) == counts()


def test_slow_machine_keeps_its_pace(graph, controllers):
    """At 0.01 a tick takes 50 ms: ten of them last half a second, and no less."""
    graph.start(MachineNode, pace=0.01)
    heard = graph.listen(DiagnosticArray, '/diagnostics')
    controllers.load(1, 11)
    controllers.run(0, 11)
    graph.next_event(CycleEvent.FINISHED)
    graph.spin_until(lambda: heard and values_of(heard[-1].status[0])['pace reached'], 'the figures of the cycle')
    values = values_of(heard[-1].status[0])
    assert values['pace'] == '0.01'
    assert 0.0 < float(values['pace reached']) <= 0.011  # the last tick needs no wait
    assert 0.0 <= float(values['late by, mean [us]']) <= float(values['late by, largest [us]'])
    assert 0.0 <= float(values['late by a tick [%]']) <= 100.0


def test_pace_changes_during_a_slow_cycle(graph, controllers):
    graph.start(MachineNode, pace=0.01)
    heard = graph.listen(DiagnosticArray, '/diagnostics')
    controllers.load(1, 40)
    controllers.run(0, 2)
    assert set_pace(graph, 0.0) == (True, '')
    controllers.run(2, 38)
    graph.next_event(CycleEvent.FINISHED)
    values, _ = told(graph, heard)
    assert (values['pace'], values['late by, mean [us]']) == ('0.0', ''), 'no tick has waited for its time'


@pytest.mark.parametrize('value', [-1.0, math.nan, math.inf, 0.001, 2000.0])
def test_pace_out_of_range_is_refused_with_its_range(graph, value):
    text = f'/pkm/machine: pace: {value} given; allowed: 0 (as fast as possible), or 0.01 to 1000 times real time'
    graph.start(MachineNode, pace=2.0)
    assert set_pace(graph, value) == (False, text)
    heard = graph.listen(DiagnosticArray, '/diagnostics')
    assert told(graph, heard)[0]['pace'] == '2.0'


@pytest.mark.parametrize('value', [-1.0, math.nan, 0.001])
def test_machine_does_not_start_with_a_pace_out_of_range(graph, value):
    with pytest.raises(PkmError, match=rf'/pkm/machine: pace: {value} given; allowed: 0 '):
        graph.start(MachineNode, pace=value)


def test_paused_machine_stands_until_it_goes_on(graph, controllers):
    """Longer than the answer timeout, and with diagnostics that say so."""
    graph.start(MachineNode, answer_timeout=IN_TIME)
    heard = graph.listen(DiagnosticArray, '/diagnostics')
    controllers.load(1, 10)
    controllers.run(0, 3)
    controllers.wait_for(3)
    assert pause(graph, True) == 'paused: tick 3 of cycle 1'
    controllers.answer(3)
    graph.spin_until(lambda: len(heard) > 2, 'diagnostics')
    controllers.wait_for(3)
    values, text = told(graph, heard)
    assert (values['state'], values['paused'], values['tick']) == ('paused', 'true', '4')
    assert text == 'paused: tick 4 of cycle 1; machine/pause with data: false continues'
    assert pause(graph, True) == 'paused already: tick 4 of cycle 1'
    assert pause(graph, False) == 'not paused: tick 4 of cycle 1'
    controllers.run(4, 6)
    graph.next_event(CycleEvent.FINISHED)


def test_cycle_of_a_paused_machine_starts_and_waits(graph, controllers):
    graph.start(MachineNode)
    assert pause(graph, True) == 'paused: no cycle runs'
    controllers.load(1, 10)
    graph.next_event(CycleEvent.STARTED)
    graph.spin_in_silence()
    assert not any(controllers.samples.values())
    assert step(graph) == (True, 'tick 0 of cycle 1')
    controllers.run(0, 1)
    pause(graph, False)
    controllers.run(1, 9)
    graph.next_event(CycleEvent.FINISHED)


def test_steps_ahead_of_the_answers_are_made_one_by_one(graph, controllers):
    graph.start(MachineNode)
    pause(graph, True)
    controllers.load(1, 10)
    graph.next_event(CycleEvent.STARTED)
    assert [step(graph)[1] for _ in range(3)] == [f'tick {tick} of cycle 1' for tick in range(3)]
    controllers.run(0, 3)
    graph.spin_in_silence()
    controllers.wait_for(2)


def test_step_is_refused_with_the_reason(graph):
    graph.start(MachineNode)
    assert step(graph) == (False, 'the machine is not paused; call machine/pause with data: true first')
    pause(graph, True)
    assert step(graph) == (False, 'no cycle runs, the machine is standing; a step is a tick of a cycle')


def test_paused_machine_stops_and_resets(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 10)
    controllers.wait_for(0)
    pause(graph, True)
    controllers.answer(0)
    graph.spin_in_silence()
    assert graph.call(Trigger, 'machine/stop').success
    assert graph.next_event(CycleEvent.FAULT).message == 'stopped by the service machine/stop'
    assert graph.call(Trigger, 'machine/reset').success
    assert step(graph)[1] == 'no cycle runs, the machine is standing; a step is a tick of a cycle'
