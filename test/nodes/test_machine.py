"""The machine and its motors: start of a cycle and accepted answers; the test replaces the joint controllers."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from std_msgs.msg import UInt32

from pkm_core.errors import ConfigError, PkmError
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.diagnostics import values_of
from pkm_nodes.nodes.machine import CLOCK_EVERY, MachineNode
from pkm_nodes.runtime.node import LAST_VALUE_QOS
from support.controllers import IN_TIME, JOINTS


@pytest.fixture
def counts_of_a_cycle(graph, controllers):
    """Return a function that runs 10 ticks on a fresh machine and returns the encoder counts."""

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


def wait_for_stale_counts(graph, diagnostics, **expected):
    """Wait for diagnostics with these stale commands by joint; they may arrive before the commands are counted."""
    wanted = {f'stale commands {joint}': str(expected.get(joint, 0)) for joint in JOINTS}
    diagnostics.clear()
    graph.spin_until(
        lambda: diagnostics and wanted.items() <= values_of(diagnostics[-1].status[0]).items(),
        f'diagnostics of {wanted}',
    )
    graph.spin_in_silence()
    assert wanted.items() <= values_of(diagnostics[-1].status[0]).items()


def test_cycle_starts_only_when_all_joints_have_loaded_it(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 10, joints=JOINTS[:3])
    graph.spin_in_silence()
    assert not any(controllers.samples.values())
    controllers.load(1, 10, joints=JOINTS[3:])
    started = graph.next_event(CycleEvent.STARTED)
    assert (started.source, started.cycle, started.tick, started.samples) == ('machine', 1, 0, 10)
    controllers.wait_for(0)


def test_joints_with_another_cycle_do_not_count(graph, controllers):
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


def test_next_cycle_continues_the_tick_count(graph, controllers):
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


def test_late_loaded_events_do_not_start_a_cycle_again(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 3)
    controllers.run(0, 3)
    graph.next_event(CycleEvent.FINISHED)
    controllers.load(1, 3)
    graph.spin_in_silence()
    controllers.wait_for(2)
    controllers.load(2, 3)
    controllers.wait_for(3)


def test_late_subscriber_gets_the_number_of_the_last_cycle(graph, controllers):
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
    wait_for_stale_counts(graph, diagnostics, d3=2, d7=1)


def test_second_answer_to_a_tick_is_counted_and_never_applied(graph, controllers, counts_of_a_cycle):
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')

    def answer_twice(tick):
        controllers.answer(tick, 0.0, joints=['d1'])
        controllers.answer(tick, 10.0, joints=['d1'])

    assert counts_of_a_cycle(before_each_answer=answer_twice) == counts_of_a_cycle()
    graph.start(MachineNode)
    controllers.answer(0, joints=['d5'])  # no tick is awaited
    wait_for_stale_counts(graph, diagnostics, d5=1)


@pytest.mark.parametrize('bad', [math.nan, math.inf])
def test_voltage_that_is_not_finite_is_not_applied(controllers, counts_of_a_cycle, bad):
    """The machine waits for a finite one."""
    disturbed = counts_of_a_cycle(before_each_answer=lambda tick: controllers.answer(tick, bad, joints=['d5']))
    assert disturbed == counts_of_a_cycle()


def test_clock_is_published_in_simulated_time(graph, controllers, machine):
    graph.start(MachineNode)
    clock = graph.listen(Clock, '/clock', qos_profile_sensor_data)
    controllers.load(1, 2 * CLOCK_EVERY + 1)
    controllers.run(0, 2 * CLOCK_EVERY + 1)
    graph.next_event(CycleEvent.FINISHED)
    period = round(CLOCK_EVERY * machine.sample_time * 1e9)
    assert [(m.clock.sec, m.clock.nanosec) for m in clock] == [(0, 0), (0, period), (0, 2 * period)]


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown; .*'four_dof'"),
        ({'environment': 'soft'}, r"'soft'.*'nominal'"),
        ({'seed': -1}, r'seed -1 given; allowed: whole numbers from 0'),
        ({'recorder_window': 0}, 'machine: recorder_window is 0 ticks; expected 1 to 999'),
        ({'recorder_window': -5}, 'machine: recorder_window is -5 ticks'),
        ({'recorder_window': 1000}, 'machine: recorder_window is 1000 ticks'),
        ({'answer_time': 1.0}, r"/pkm/machine has unknown parameter\(s\) \['answer_time'\]; known: .*'answer_timeout'"),
        ({'answer_timeout': math.nan}, r'/pkm/machine: answer_timeout is nan; expected a positive, finite number'),
        ({'start_timeout': -1.0}, r'/pkm/machine: start_timeout is -1.0; expected a positive, finite number'),
    ],
)
def test_invalid_parameter_is_refused_by_name(graph, parameters, text):
    with pytest.raises(PkmError, match=text):
        graph.start(MachineNode, **parameters)


def test_parameter_of_the_wrong_type_is_refused_by_name(graph):
    with pytest.raises(ConfigError, match=r'answer_timeout is 5 \(integer\); expected double'):
        graph.start(MachineNode, answer_timeout=5)


@pytest.mark.parametrize('data', [b'\0\1\0\0' + bytes(6), b'\0\0\0\0' + bytes(40), b'\0\1\0\0'], ids=len)
def test_malformed_command_is_dropped_and_counted(graph, controllers, data):
    """Too short, big-endian, empty: none of them moves the machine or ends it. DDS itself refuses longer ones."""
    machine = graph.start(MachineNode)
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
    controllers.load(1, 3)
    controllers.wait_for(0)
    controllers.send('d3', data)
    graph.spin_in_silence()
    assert len(controllers.samples['d3']) == 1, 'not advanced'
    for tick in range(3):
        controllers.wait_for(tick)
        controllers.answer(tick, 0.0)
    graph.next_event(CycleEvent.FINISHED)
    assert sum(motor.refused_messages() for motor in machine.parts) == 1
    graph.spin_until(
        lambda: diagnostics and values_of(diagnostics[-1].status[0])['refused messages'] == '1', 'its count'
    )
