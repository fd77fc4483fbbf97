"""Identity of a cell: events and goals of another session do not count, nor a second machine or publisher."""

import pytest
from rclpy.parameter import Parameter

from pkm_core.errors import PkmError
from pkm_core.servo import cycle_run
from pkm_interfaces.msg import CycleEvent, MotorCommand
from pkm_interfaces.srv import SaveLearned, UpdateFeedforward
from pkm_nodes.nodes.learning import LearningNode
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.runtime.node import CYCLE_QOS
from pkm_nodes.runtime.session import belongs, checked_session, new_session
from support.controllers import IN_TIME, JOINTS


def loaded(joint, session):
    return CycleEvent(event=CycleEvent.LOADED, session=session, source=joint, cycle=1, samples=10)


def test_new_sessions_differ_and_are_no_numbers_of_yaml():
    sessions = {new_session() for _ in range(1000)}
    assert len(sessions) == 1000
    assert all(checked_session(session) == session and session[0] == 's' for session in sessions)


@pytest.mark.parametrize('text', ['3e5', 'a b', 'a' * 65, '../x', 'é'])
def test_text_that_can_be_no_session_is_refused(text):
    with pytest.raises(PkmError, match=r'session: .* given; expected at most 64'):
        checked_session(text)


def test_empty_session_fits_every_other():
    assert belongs('', 'a')
    assert belongs('a', '')
    assert belongs('a', 'a')
    assert not belongs('a', 'b')


def test_events_of_another_session_start_no_cycle(graph, controllers):
    graph.start(MachineNode, session='mine')
    events = graph.publisher(CycleEvent, 'cycle_events', CYCLE_QOS)
    for joint in JOINTS:
        events.publish(loaded(joint, 'other'))
    graph.spin_in_silence()
    assert not any(controllers.samples.values())
    events.publish(CycleEvent(event=CycleEvent.ANNOUNCED, cycle=1))
    for joint in JOINTS:
        events.publish(loaded(joint, 'mine'))
    started = graph.next_event(CycleEvent.STARTED)
    assert started.session == 'mine'


def test_goal_of_another_session_is_refused_with_both_named(graph, goals):
    graph.start(TrajectoryGeneratorNode, session='mine')
    _, result = goals.result(goals.send(session='other', motion='four_dof_70ms'))
    assert result.message == "goal: for the cell of session 'other'; this cell has session 'mine'"
    assert result.session == 'mine'


def test_request_of_another_session_saves_nothing(graph, tmp_path):
    graph.start(LearningNode, session='mine')
    request = SaveLearned.Request(session='other', path=str(tmp_path / 'x.npz'))
    answer = graph.call(SaveLearned, 'learning/save', request)
    assert not answer.success
    assert "session 'other'; this cell has session 'mine'" in answer.message
    assert not list(tmp_path.iterdir())


def test_error_of_another_session_is_not_learned(graph):
    graph.start(LearningNode, session='mine')
    answer = graph.call(UpdateFeedforward, 'learning/update', UpdateFeedforward.Request(session='other', joint='d1'))
    assert (answer.success, answer.session) == (False, 'mine')
    assert answer.message == "learning/update: for the cell of session 'other'; this cell has session 'mine'"


def test_second_machine_is_refused_and_the_first_named(graph):
    first = graph.start(MachineNode, session='first')
    with pytest.raises(PkmError, match=r'a cell runs in /pkm: node /pkm/machine, host .*, pid \d+, .* session first'):
        MachineNode(parameter_overrides=[Parameter('session', value='second')])
    graph.stop(first)
    graph.start(MachineNode, session='second')


def test_second_publisher_of_commands_is_named_at_the_start(graph, controllers, monkeypatch):
    """Two controllers of d3 would both answer; the first one won without a message."""
    monkeypatch.setattr(cycle_run, 'LEASE', IN_TIME)
    graph.start(MachineNode, start_timeout=IN_TIME)
    graph.publisher(MotorCommand, 'd3/command')
    controllers.load(1, 10)
    refused = graph.next_event(CycleEvent.REFUSED)
    assert '/pkm/d3/command has 2 publishers, /pkm/test, /pkm/test; allowed: one each' in refused.message
    assert not any(controllers.samples.values())
