"""What the machine finds beside its cell before and during a cycle; the test replaces the joint controllers."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from pkm_core.servo import cycle_run
from pkm_interfaces.msg import CycleEvent, MotorCommand, SampledTrajectory
from pkm_interfaces.srv import UpdateFeedforward
from pkm_nodes.messages.diagnostics import values_of
from pkm_nodes.nodes.machine import MachineNode
from support.controllers import IN_TIME


@pytest.fixture
def machine(graph, monkeypatch):
    """Return a running machine that does not wait until DDS forgets killed nodes."""
    monkeypatch.setattr(cycle_run, 'LEASE', 0.0)
    return graph.start(MachineNode, start_timeout=0.1)


@pytest.mark.usefixtures('machine')
def test_cycle_without_a_goal_is_refused(graph, controllers):
    controllers.load_only(1, 10)
    refused = graph.next_event(CycleEvent.REFUSED, cycle=1)
    assert refused.message == (
        'cycle 1: belongs to no running goal; only the trajectory source of this cell starts cycles'
    )
    assert not any(controllers.samples.values())
    controllers.load(2, 10)
    graph.next_event(CycleEvent.STARTED, cycle=2)


@pytest.mark.usefixtures('machine')
def test_second_learning_service_is_named_and_the_cycle_refused(graph, controllers):
    servers = [graph.node.create_service(UpdateFeedforward, 'learning/update', lambda _, r: r) for _ in range(2)]
    controllers.load(1, 10)
    refused = graph.next_event(CycleEvent.REFUSED, cycle=1)
    assert 'service /pkm/learning/update has 2 servers, /pkm/test' in refused.message
    assert refused.message.endswith('; allowed: one each. Stop the others')
    graph.node.destroy_service(servers.pop())


@pytest.mark.usefixtures('machine')
def test_second_source_of_joint_trajectories_is_named(graph, controllers):
    """The trajectory_generator, which publishes them in identifications, does not count."""
    graph.publisher(SampledTrajectory, 'joint_trajectory')
    graph.publisher(SampledTrajectory, 'joint_trajectory')
    controllers.load(1, 10)
    text = '/pkm/joint_trajectory has 2 publishers, /pkm/test, /pkm/test'
    assert text in graph.next_event(CycleEvent.REFUSED, cycle=1).message
    graph.publisher(SampledTrajectory, 'pose_trajectory')  # now the test is the trajectory source
    graph.spin_until(lambda: started_after(graph, controllers), 'the start of a cycle', timeout=10 * IN_TIME)


def started_after(graph, controllers):
    controllers.load(2, 10)
    graph.spin_in_silence()
    return any(event.event == CycleEvent.STARTED for event in graph.events)


@pytest.mark.usefixtures('machine')
def test_publisher_that_comes_during_a_cycle_is_named(graph, controllers):
    """In diagnostics, and in a NOTICE, which the recorder puts into the bag."""
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
    controllers.load(1, 10)
    controllers.run(0, 3)
    graph.publisher(MotorCommand, 'd3/command')
    notice = graph.next_event(CycleEvent.NOTICE, source='machine', cycle=1)
    assert notice.message == 'messages of further publishers are dropped: /pkm/d3/command: /pkm/test'
    graph.spin_until(
        lambda: diagnostics and values_of(diagnostics[-1].status[0])['other publishers'] == notice.message, 'a warning'
    )
    assert diagnostics[-1].status[0].level == b'\x01'
    controllers.run(3, 7)
    graph.next_event(CycleEvent.FINISHED, cycle=1)
