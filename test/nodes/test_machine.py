"""The machine and its motors; the test stands in the place of the joint controllers and the recorder."""

import math
import re

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.exceptions import ParameterException
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from std_msgs.msg import UInt32, UInt64
from std_srvs.srv import Trigger

from pkm_core.errors import PkmError
from pkm_core.laser_clock import sample_numbers
from pkm_interfaces.msg import CycleEvent, EncoderSample, LaserSample, MotorCommand
from pkm_nodes.machine import BRAKE_TICKS, CLOCK_EVERY, LASER_EVERY, MachineNode
from pkm_nodes.node import LAST_VALUE_QOS

JOINTS = ('d1', 'd3', 'd5', 'd7')
# [s, wall] in which this process answers also on a busy machine, and not so long that waiting for its end hurts
IN_TIME = 1.0


class Controllers:
    """The test in the place of the joint controllers: loads cycles, hears samples, answers when and what it likes."""

    def __init__(self, graph):
        self._graph = graph
        self._events = graph.publisher(CycleEvent, 'cycle_events')
        self._commands = {joint: graph.publisher(MotorCommand, f'{joint}/command') for joint in JOINTS}
        self.samples = {joint: graph.listen(EncoderSample, f'{joint}/encoder') for joint in JOINTS}

    def load(self, cycle, samples, joints=JOINTS):
        """Report `cycle` as loaded by `joints`; `samples` is its length, or the lengths by joint."""
        for joint in joints:
            length = samples[joint] if isinstance(samples, dict) else samples
            self._events.publish(CycleEvent(event=CycleEvent.LOADED, source=joint, cycle=cycle, samples=length))

    def wait_for(self, tick, mode=EncoderSample.RUN):
        self._graph.spin_until(
            lambda: all(heard and heard[-1].tick >= tick for heard in self.samples.values()), f'samples of tick {tick}'
        )
        assert {(heard[-1].tick, heard[-1].mode) for heard in self.samples.values()} == {(tick, mode)}

    def answer(self, tick, volts=0.0, joints=JOINTS):
        for joint in joints:
            self._commands[joint].publish(MotorCommand(tick=tick, voltage=volts))

    def run(self, first, ticks, volts=0.0):
        """Answer `ticks` ticks from tick `first` on."""
        for tick in range(first, first + ticks):
            self.wait_for(tick)
            self.answer(tick, volts)

    def counts(self):
        return {joint: [sample.counts for sample in heard] for joint, heard in self.samples.items()}


@pytest.fixture
def controllers(graph):
    return Controllers(graph)


@pytest.fixture
def counts_of_a_cycle(graph, controllers):
    """Return a function that runs 10 ticks on a fresh machine and gives what the encoders counted."""

    def run(volts=0.0, *, before_each_answer=lambda tick: None):
        machine = graph.start(MachineNode)
        controllers.load(1, 10)
        for tick in range(10):
            controllers.wait_for(tick)
            before_each_answer(tick)
            controllers.answer(tick, volts)
        graph.next_event(CycleEvent.FINISHED)
        counts = controllers.counts()
        for heard in controllers.samples.values():
            heard.clear()
        graph.stop(machine)
        return counts

    return run


def stale_counts(graph, diagnostics):
    """Wait for the next diagnostics and return the stale commands by joint."""
    diagnostics.clear()
    graph.spin_until(lambda: diagnostics, 'diagnostics')
    values = {entry.key: entry.value for entry in diagnostics[-1].status[0].values}
    return {joint: int(values[f'stale commands {joint}']) for joint in JOINTS}


def test_cycle_starts_only_when_all_joints_have_loaded_it(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 10, joints=JOINTS[:3])
    graph.spin_in_silence()
    assert not any(controllers.samples.values())
    controllers.load(1, 10, joints=JOINTS[3:])
    started = graph.next_event(CycleEvent.STARTED)
    assert (started.source, started.cycle, started.tick, started.samples) == ('machine', 1, 0, 10)
    controllers.wait_for(0)


def test_joints_that_have_loaded_another_cycle_do_not_count(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 10, joints=JOINTS[:3])
    controllers.load(2, 10, joints=JOINTS[3:])
    graph.spin_in_silence()
    assert not any(controllers.samples.values())
    controllers.load(2, 10, joints=JOINTS[:3])
    graph.next_event(CycleEvent.STARTED, cycle=2)


def test_joints_that_do_not_load_in_time_are_named(graph, controllers):
    graph.start(MachineNode, start_timeout=IN_TIME)
    controllers.load(1, 10, joints=('d1', 'd5'))
    refused = graph.next_event(CycleEvent.REFUSED)
    assert (refused.source, refused.cycle) == ('machine', 1)
    assert refused.message == f"cycle 1: not loaded within {IN_TIME} s by joint_controller of ['d3', 'd7']"
    controllers.load(1, 10)
    graph.next_event(CycleEvent.STARTED)


def test_cycles_of_different_lengths_are_refused(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, {'d1': 10, 'd3': 10, 'd5': 12, 'd7': 10})
    refused = graph.next_event(CycleEvent.REFUSED)
    assert "{'d1': 10, 'd3': 10, 'd5': 12, 'd7': 10}; all must be equal" in refused.message
    controllers.load(2, 10)
    graph.next_event(CycleEvent.STARTED, cycle=2)


def test_machine_advances_only_when_every_joint_has_answered(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 10)
    controllers.wait_for(0)
    controllers.answer(0, joints=JOINTS[:3])
    graph.spin_in_silence()
    controllers.wait_for(0)
    controllers.answer(0, joints=JOINTS[3:])
    controllers.wait_for(1)


def test_cycle_ends_with_its_last_tick_and_the_next_one_goes_on_from_there(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 3)
    controllers.run(0, 3)
    finished = graph.next_event(CycleEvent.FINISHED)
    assert (finished.cycle, finished.tick, finished.samples) == (1, 3, 3)
    controllers.load(2, 2)
    controllers.run(3, 2)
    graph.next_event(CycleEvent.FINISHED)
    for heard in controllers.samples.values():
        assert [(s.tick, s.cycle, s.index) for s in heard] == [(0, 1, 0), (1, 1, 1), (2, 1, 2), (3, 2, 0), (4, 2, 1)]


def test_cycle_that_has_run_is_not_started_again_by_a_late_word_of_the_joints(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 3)
    controllers.run(0, 3)
    graph.next_event(CycleEvent.FINISHED)
    controllers.load(1, 3)
    graph.spin_in_silence()
    controllers.wait_for(2)
    controllers.load(2, 3)
    controllers.wait_for(3)


def test_whoever_comes_late_hears_which_cycle_was_started_last(graph, controllers):
    graph.start(MachineNode)
    controllers.load(7, 3)
    graph.next_event(CycleEvent.STARTED)
    heard = graph.listen(UInt32, 'machine/cycle', LAST_VALUE_QOS)
    graph.spin_until(lambda: heard, 'the number of the cycle')
    assert heard[0].data == 7


def test_position_is_counts_times_resolution(graph, controllers, machine):
    graph.start(MachineNode)
    controllers.load(1, 1)
    controllers.wait_for(0)
    for home, heard in zip(machine.home, controllers.samples.values(), strict=True):
        assert heard[0].position == heard[0].counts * machine.encoder_resolution
        assert heard[0].position == pytest.approx(home, abs=machine.encoder_resolution)


def test_answers_to_another_tick_are_counted_and_never_applied(graph, controllers, counts_of_a_cycle):
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')

    def send_stale(tick):
        controllers.answer(tick + 1, 10.0, joints=['d3'])
        if tick:
            controllers.answer(tick - 1, 10.0, joints=['d3', 'd7'])

    undisturbed = counts_of_a_cycle()
    assert counts_of_a_cycle(10.0) != undisturbed
    assert counts_of_a_cycle(before_each_answer=send_stale) == undisturbed

    graph.start(MachineNode)
    controllers.load(1, 10)
    controllers.wait_for(0)
    controllers.answer(7, joints=['d3', 'd3', 'd7'])
    assert stale_counts(graph, diagnostics) == {'d1': 0, 'd3': 2, 'd5': 0, 'd7': 1}


def test_second_answer_to_a_tick_is_counted_and_never_applied(graph, controllers, counts_of_a_cycle):
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')

    def answer_twice(tick):
        controllers.answer(tick, 0.0, joints=['d1'])
        controllers.answer(tick, 10.0, joints=['d1'])

    assert counts_of_a_cycle(before_each_answer=answer_twice) == counts_of_a_cycle()
    graph.start(MachineNode)
    controllers.answer(0, joints=['d5'])  # nobody has asked
    assert stale_counts(graph, diagnostics) == {'d1': 0, 'd3': 0, 'd5': 1, 'd7': 0}


@pytest.mark.parametrize('bad', [math.nan, math.inf])
def test_voltage_that_is_not_finite_is_not_applied_and_the_machine_waits_for_a_finite_one(
    controllers, counts_of_a_cycle, bad
):
    disturbed = counts_of_a_cycle(before_each_answer=lambda tick: controllers.answer(tick, bad, joints=['d5']))
    assert disturbed == counts_of_a_cycle()


def test_joint_that_answers_only_nan_is_named_with_what_it_sent(graph, controllers):
    graph.start(MachineNode, answer_timeout=IN_TIME)
    controllers.load(1, 10)
    controllers.wait_for(0)
    controllers.answer(0, joints=['d1', 'd3', 'd5'])
    controllers.answer(0, math.nan, joints=['d7'])
    message = graph.next_event(CycleEvent.FAULT).message
    assert message.endswith('from joint_controller of d7 (answered with nan V; expected a finite voltage)')


def test_missing_answers_stop_the_machine_safely_and_name_exactly_who_is_missing(graph, controllers):
    graph.start(MachineNode, answer_timeout=IN_TIME)
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
    controllers.load(1, 10)
    controllers.run(0, 4)
    controllers.wait_for(4)
    controllers.answer(4, joints=['d1', 'd5'])

    fault = graph.next_event(CycleEvent.FAULT)
    assert (fault.source, fault.cycle, fault.samples) == ('machine', 1, 4)
    assert fault.message.startswith(f'tick 4 (cycle 1, sample 4): no answer for {IN_TIME:.1f} s from ')
    assert fault.message.endswith('joint_controller of d3, joint_controller of d7')
    assert fault.tick == 5 + BRAKE_TICKS
    controllers.wait_for(fault.tick - 1, EncoderSample.SAFE_STOP)
    for heard in controllers.samples.values():
        assert [s.tick for s in heard] == list(range(fault.tick))
        assert [s.mode for s in heard] == [EncoderSample.RUN] * 5 + [EncoderSample.SAFE_STOP] * BRAKE_TICKS
    diagnostics.clear()
    graph.spin_until(lambda: diagnostics, 'diagnostics')
    assert fault.message in diagnostics[-1].status[0].message


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
    assert response.message == 'cycle 1 is running; a reset is for a machine that stands'
    controllers.run(0, 10)
    graph.next_event(CycleEvent.FINISHED)


def test_carriage_that_runs_into_its_stop_is_a_fault(graph, controllers):
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
        assert max(last) - min(last) <= 5, 'it stands, but for the noise of the encoders: 1 um in 10 ms'


def test_laser_samples_of_a_cycle_are_told_before_its_end_and_go_on_in_the_next(graph, controllers, machine):
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


def test_laser_measures_through_a_safe_stop_and_after_the_reset(graph, controllers, machine):
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


def test_clock_is_published_in_simulated_time(graph, controllers, machine):
    graph.start(MachineNode)
    clock = graph.listen(Clock, '/clock', qos_profile_sensor_data)
    controllers.load(1, 2 * CLOCK_EVERY + 1)
    controllers.run(0, 2 * CLOCK_EVERY + 1)
    graph.next_event(CycleEvent.FINISHED)
    period = round(CLOCK_EVERY * machine.sample_time * 1e9)
    assert [(m.clock.sec, m.clock.nanosec) for m in clock] == [(0, 0), (0, period), (0, 2 * period)]


def test_machine_that_waits_for_a_recorder_starts_when_it_has_reported(graph, controllers):
    graph.start(MachineNode, wait_for_recorder=True)
    recorder = graph.publisher(UInt64, 'recorder/tick')
    controllers.load(1, 10)
    graph.spin_in_silence()
    assert not any(controllers.samples.values())
    recorder.publish(UInt64(data=0))
    graph.next_event(CycleEvent.STARTED)


def test_recorder_that_does_not_report_is_named(graph, controllers):
    graph.start(MachineNode, wait_for_recorder=True, start_timeout=0.2)
    controllers.load(1, 10)
    refused = graph.next_event(CycleEvent.REFUSED)
    assert refused.message == 'cycle 1: the recorder has not reported within 0.2 s; is it running?'


def test_machine_runs_no_further_ahead_of_the_recorder_than_its_window(graph, controllers):
    graph.start(MachineNode, wait_for_recorder=True, recorder_window=5)
    recorder = graph.publisher(UInt64, 'recorder/tick')
    recorder.publish(UInt64(data=0))
    controllers.load(1, 20)
    controllers.run(0, 6)
    graph.spin_in_silence()
    controllers.wait_for(5)
    recorder.publish(UInt64(data=3))
    controllers.run(6, 3)
    graph.spin_in_silence()
    controllers.wait_for(8)


def test_recorder_that_falls_silent_in_a_cycle_stops_the_machine_safely(graph, controllers):
    graph.start(MachineNode, wait_for_recorder=True, recorder_window=2, answer_timeout=IN_TIME)
    graph.publisher(UInt64, 'recorder/tick').publish(UInt64(data=0))
    controllers.load(1, 20)
    controllers.run(0, 3)
    fault = graph.next_event(CycleEvent.FAULT)
    assert 'the recorder has not confirmed anything after tick 0' in fault.message
    controllers.wait_for(fault.tick - 1, EncoderSample.SAFE_STOP)
    for heard in controllers.samples.values():
        assert [s.tick for s in heard] == list(range(fault.tick))


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown; .*'four_dof'"),
        ({'environment': 'soft'}, r"'soft'.*'nominal'"),
        ({'seed': -1}, r'seed -1 given; expected a whole number from 0'),
        ({'recorder_window': 0}, 'machine: recorder_window is 0 ticks; expected 1 to 999'),
        ({'recorder_window': -5}, 'machine: recorder_window is -5 ticks'),
        ({'recorder_window': 1000}, 'machine: recorder_window is 1000 ticks'),
        ({'answer_time': 1.0}, r"/pkm/machine has unknown parameter\(s\) \['answer_time'\]; known: .*'answer_timeout'"),
        ({'answer_timeout': math.nan}, r'/pkm/machine: answer_timeout is nan; expected a positive, finite number'),
        ({'start_timeout': -1.0}, r'/pkm/machine: start_timeout is -1.0; expected a positive, finite number'),
    ],
)
def test_parameter_that_cannot_be_is_refused_by_name(graph, parameters, text):
    with pytest.raises(PkmError, match=text):
        graph.start(MachineNode, **parameters)


def test_parameter_of_the_wrong_type_is_refused_by_name(graph):
    with pytest.raises(ParameterException, match=r"answer_timeout.*'5'.*INTEGER.*DOUBLE"):
        graph.start(MachineNode, answer_timeout=5)
