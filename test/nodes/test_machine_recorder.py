"""How the machine waits for a recorder; the test replaces the recorder and the joint controllers."""

from std_msgs.msg import UInt64

from pkm_interfaces.msg import CycleEvent, EncoderSample
from pkm_nodes.nodes.machine import MachineNode
from support.controllers import IN_TIME


def test_trajectories_before_the_recorder_reports_do_not_count(graph, controllers):
    """The recorder may have missed them; they are resent every second."""
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


def test_recorder_without_a_report_is_named_in_the_refusal(graph, controllers):
    graph.start(MachineNode, wait_for_recorder=True, start_timeout=0.2)
    controllers.load(1, 10)
    refused = graph.next_event(CycleEvent.REFUSED)
    assert refused.message == 'cycle 1: the recorder has not reported within 0.2 s; is it running?'


def test_machine_stays_within_the_recorder_window(graph, controllers):
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


def test_silent_recorder_in_a_cycle_causes_a_safe_stop(graph, controllers):
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
