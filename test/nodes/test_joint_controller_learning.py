"""Learning of one joint controller over cycles; the test replaces machine and service."""

import math
from array import array

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.task import Future

from pkm_core.learning.monitor import LEARNED
from pkm_interfaces.msg import CycleEvent
from pkm_interfaces.srv import UpdateFeedforward
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.parts import axis_learning
from support.axis import SAMPLES, UM, feedforward_of


def test_reply_of_learning_is_the_next_feedforward(graph, axis, learning, machine):
    """The request follows the last tick and holds error, feedforward and iteration of the cycle."""
    graph.start(JointControllerNode, joint='d3')
    learned = [0.01 * index for index in range(SAMPLES)]
    learning.will_answer(learned)
    learning.will_answer([2.0] * SAMPLES)

    axis.load(1, learning_law='fourier')
    first = axis.run(1, lambda index: index * UM)
    assert feedforward_of(first) == [0.0] * SAMPLES
    axis.load(2, learning_law='fourier')
    assert feedforward_of(axis.run(2)) == learned
    axis.load(3, learning_law='fourier')
    assert feedforward_of(axis.run(3)) == [2.0] * SAMPLES

    before, after = learning.requests[:2]
    assert (before.joint, before.law, before.motion, before.iteration) == ('d3', 'fourier', 'short', 0)
    assert before.sample_time == machine.sample_time
    assert list(before.error) == [command.error for command in first]
    assert list(before.feedforward) == [0.0] * SAMPLES
    assert after.iteration == 1
    assert list(after.feedforward) == learned


def test_learned_feedforward_adds_to_the_voltage(graph, axis, learning):
    graph.start(JointControllerNode, joint='d3')
    # the learned part starts at zero: loading does not shift the integrator, so the voltages differ by it alone
    learning.will_answer([0.0] * 30 + [0.5] * 10)
    axis.load(1, learning_law='fourier')
    first = axis.run(1)
    axis.load(2, learning_law='fourier')
    second = axis.run(2)
    assert second[30].voltage > first[30].voltage + 0.1


def test_nothing_is_learned_with_law_none(graph, axis, learning):
    graph.start(JointControllerNode, joint='d3')
    for cycle in (1, 2):
        axis.load(cycle, learning_law='none')
        assert feedforward_of(axis.run(cycle, lambda index: index * UM)) == [0.0] * SAMPLES
    assert not learning.requests


def answers_too_short(learning):
    learning.will_answer([2.0] * (SAMPLES - 1))


def answers_nan(learning):
    learning.will_answer([math.nan] * SAMPLES)


def answers_too_much(learning):
    learning.will_answer([0.0] * (SAMPLES - 1) + [-10.1])


def refuses(learning):
    learning.will_refuse('learning d3: not today')


def is_of_another_cell(learning):
    learning.will_answer([2.0] * SAMPLES, session='other')


@pytest.mark.parametrize('fails', [refuses, answers_too_short, answers_nan, answers_too_much, is_of_another_cell])
def test_failed_learning_keeps_the_feedforward(graph, axis, learning, fails):
    """The next request continues from it, with the same iteration."""
    graph.start(JointControllerNode, joint='d3', session='mine')
    learning.will_answer([1.0] * SAMPLES)
    fails(learning)
    learning.will_answer([3.0] * SAMPLES)
    applied = []
    for cycle in range(1, 5):
        axis.load(cycle, learning_law='fourier')
        applied.append(axis.run(cycle)[0].feedforward)
        if cycle < 4:
            graph.spin_until(lambda n=cycle: len(learning.requests) == n, 'a request to learn')
    assert applied == [0.0, 1.0, 1.0, 3.0]
    assert {request.session for request in learning.requests} == {'mine'}
    assert [request.iteration for request in learning.requests[:3]] == [0, 1, 1]


@pytest.mark.parametrize('changed', [{'motion': 'other'}, {'learning_law': 'fourier_pid'}, {'motion': 'same name'}])
def test_changed_motion_or_law_starts_learning_from_zero(graph, axis, learning, changed):
    graph.start(JointControllerNode, joint='d3')
    learning.will_answer([1.0] * SAMPLES)
    learning.will_answer([2.0] * SAMPLES)
    axis.load(1, learning_law='fourier')
    axis.run(1)
    second = axis.message(2, **{'learning_law': 'fourier', **changed})
    if changed == {'motion': 'same name'}:
        second.motion = 'short'
        for row in range(SAMPLES):
            second.position[4 * row + axis.column] += 0.5 * UM  # still at home
    axis.send(second)
    graph.next_event(CycleEvent.LOADED, cycle=2)
    assert feedforward_of(axis.run(2)) == [0.0] * SAMPLES
    graph.spin_until(lambda: len(learning.requests) == 2, 'the second request to learn')
    assert learning.requests[1].iteration == 0
    assert list(learning.requests[1].feedforward) == [0.0] * SAMPLES


def test_cycle_is_loaded_after_the_reply_of_learning(graph, axis):
    gate = Future()

    async def answer_later(request, response):
        response.success, response.feedforward = True, await gate
        return response

    graph.node.create_service(UpdateFeedforward, 'learning/update', answer_later)
    graph.start(JointControllerNode, joint='d3')
    axis.load(1, learning_law='fourier')
    axis.run(1)
    axis.send(axis.message(2, learning_law='fourier'))
    graph.spin_in_silence()
    assert not graph.events
    gate.set_result(array('d', [1.0] * SAMPLES))
    graph.next_event(CycleEvent.LOADED, cycle=2)
    axis.sample(2, 0, axis.reference[0])
    assert axis.answer().feedforward == 1.0


def test_learning_that_does_not_answer_ends_the_goal(graph, axis, monkeypatch):
    """Figures must not depend on the time that learning takes; the next goal goes on with the previous feedforward."""
    monkeypatch.setattr(axis_learning, 'LEARNING_TIMEOUT', 0.2)
    graph.start(JointControllerNode, joint='d3')
    axis.load(1, learning_law='fourier')
    axis.run(1)
    axis.send(axis.message(2, learning_law='fourier'))
    refused = graph.next_event(CycleEvent.REFUSED, cycle=2)
    assert refused.message == (
        'd3: no answer from learning/update to cycle 1 for 0.2 s: its node learning has ended, is stopped or stuck'
    )
    axis.load(3, learning_law='fourier')
    assert feedforward_of(axis.run(3)) == [0.0] * SAMPLES


def test_divergence_restores_the_best_feedforward(graph, axis, learning):
    """It is detected within two cycles, reported, and learning restarts at iteration 0."""
    graph.start(JointControllerNode, joint='d3')
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
    errors = [20 * UM, 4 * UM, 5 * UM, 13 * UM, 40 * UM, 4 * UM]  # from the fourth cycle on learning makes it worse
    for level in range(1, 6):
        learning.will_answer([0.1 * level] * SAMPLES)
    driven = []
    for cycle, error in enumerate(errors, start=1):
        axis.load(cycle, learning_law='fourier')
        driven.append(axis.run(cycle, lambda index, error=error: error)[-1].feedforward)
    assert driven == [0.0, 0.1, 0.2, 0.30000000000000004, 0.4, 0.1]
    notice = graph.next_event(CycleEvent.NOTICE)
    assert (notice.source, notice.cycle) == ('d3', 5)
    assert notice.message.startswith('learning of d3 diverges: 5.0, 13.0, 40.0 um rms')
    assert 'returned to the feedforward with 4.0 um' in notice.message
    graph.spin_until(lambda: any(s.level == DiagnosticStatus.WARN for m in diagnostics for s in m.status), 'a warning')
    assert diagnostics[-1].status[0].message == notice.message
    graph.spin_until(lambda: len(learning.requests) == 5, 'the request of the sixth cycle')
    assert [request.iteration for request in learning.requests] == [0, 1, 2, 3, 0]


def test_feedforward_of_the_trajectory_is_applied_and_learned(graph, axis, learning):
    graph.start(JointControllerNode, joint='d3')
    learning.will_answer([3.0] * SAMPLES)
    learning.will_answer([4.0] * SAMPLES)
    message = axis.message(1, learning_law='fourier')
    given = np.zeros((SAMPLES, 4))
    given[:, axis.column] = np.linspace(0, 1, SAMPLES)
    message.feedforward = array('d', given.tobytes())
    axis.send(message)
    graph.next_event(CycleEvent.LOADED, cycle=1)
    for cycle in (1, 2):  # nothing is learned from cycle 1: its friction starts at rest
        assert feedforward_of(axis.run(cycle)) == list(given[:, axis.column])
        axis.load(cycle + 1, learning_law='fourier')
    assert feedforward_of(axis.run(3)) == [3.0] * SAMPLES
    graph.spin_until(lambda: len(learning.requests) == 2, 'two requests')
    assert list(learning.requests[0].feedforward) == list(given[:, axis.column])
    assert [request.cycle for request in learning.requests] == [2, 3]
    assert [request.iteration for request in learning.requests] == [LEARNED, LEARNED + 1]


@pytest.mark.parametrize(
    ('feedforward', 'text'),
    [
        ([0.0] * (SAMPLES * 4 - 1), '159 feedforward values; expected 40 x 4'),
        ([math.nan] * (SAMPLES * 4), 'not finite'),
    ],
)
def test_invalid_feedforward_is_refused(graph, axis, feedforward, text):
    graph.start(JointControllerNode, joint='d3')
    message = axis.message(1)
    message.feedforward = array('d', feedforward)
    axis.send(message)
    assert text in graph.next_event(CycleEvent.REFUSED, cycle=1).message


def test_command_at_its_limit_is_noticed(graph, axis, machine):
    """Without a law too; the event counts the samples of the cycle."""
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    commands = axis.run(1, lambda index: 9e-4 if 10 <= index < 13 else 0.0)  # [m] less than 1 mm
    limited = sum(abs(command.voltage) == machine.voltage_limit for command in commands)
    assert limited > 0
    notice = graph.next_event(CycleEvent.NOTICE, cycle=1)
    assert f'd3: {limited} of {SAMPLES} samples at the limit of 10 V' in notice.message
