"""How the machine waits for a recorder; the test stands in its place and in that of the joint controllers."""

from std_msgs.msg import UInt64

from pkm_interfaces.msg import CycleEvent, EncoderSample
from pkm_nodes.nodes.machine import MachineNode
from support.controllers import IN_TIME


def test_machine_starts_with_trajectories_that_come_after_the_first_word_of_the_recorder(graph, controllers):
    """Those before it the recorder may have missed; they are sent again every second."""
    graph.start(MachineNode, wait_for_recorder=True)
    recorder = graph.publisher(UInt64, 'recorder/tick')
    controllers.load(1, 10)
    graph.spin_in_silence()
    assert not any(controllers.samples.values())
    recorder.publish(UInt64(data=0))
    graph.spin_in_silence()
    assert not any(controllers.samples.values())
    controllers.load(1, 10)
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
    graph.spin_in_silence()
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
    graph.spin_in_silence()
    controllers.load(1, 20)
    controllers.run(0, 3)
    fault = graph.next_event(CycleEvent.FAULT)
    assert 'the recorder has not confirmed anything after tick 0' in fault.message
    controllers.wait_for(fault.tick - 1, EncoderSample.SAFE_STOP)
    for heard in controllers.samples.values():
        assert [s.tick for s in heard] == list(range(fault.tick))
