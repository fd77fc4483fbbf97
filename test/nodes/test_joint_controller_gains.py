"""Gains of a running joint controller: applied without a voltage step, or refused; the test replaces the machine."""

import math
import re
from array import array

import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from pkm_core.control.robust import load_control
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.parts.gain_parameters import gains_from_msg
from support.axis import SAMPLES, UM


def set_gains(graph, **values):
    """Set parameters of the controller together and return (successful, reason)."""
    request = SetParametersAtomically.Request(
        parameters=[
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg() for name, value in values.items()
        ]
    )
    result = graph.call(SetParametersAtomically, 'joint_controller/set_parameters_atomically', request).result
    return result.successful, result.reason


def test_gains_change_during_a_cycle_without_a_voltage_step(graph, axis, law, joint_trajectory):
    graph.start(JointControllerNode, joint='d3')
    message = joint_trajectory(1)
    law.load(
        *(np.array(getattr(message, n)).reshape(-1, 4)[:, 1] for n in ('position', 'velocity', 'acceleration', 'jerk')),
        np.zeros(SAMPLES),
    )
    other = law.gains.model_copy(update={'kp': 0.8 * law.gains.kp, 'ki': 0.7 * law.gains.ki})
    axis.load(1)
    for index, reference in enumerate(axis.reference):
        if index == 15:
            assert set_gains(graph, kp=other.kp, ki=other.ki) == (True, '')
            law.exchange(other)  # without a voltage step, see test_robust.py
        axis.sample(1, index, reference - 3 * UM)
        assert axis.answer().voltage == law.update(index, reference - 3 * UM)[0]


@pytest.mark.parametrize(
    ('values', 'text'),
    [
        ({'kp': 60000.0}, r'the loop is unstable: .*; allowed below 1, gain margin -\d+\.\d dB'),
        ({'kd': 80.0}, r'the loop has gain margin \d\.\d dB, allowed from 6'),
        ({'kp': 10000.0}, r'the loop has phase margin 2\d\.\d deg, allowed from 30'),
        ({'kp': 1500.0}, r'the loop has gain reduction \d\.\d dB, allowed from 6'),
        ({'kp': math.nan}, r'kp: nan given; .*finite'),
        ({'kp': -1.0}, r'kp: -1.0 given; allowed > 0'),
        ({'notch__centre': 1200.0}, r'notch: centre is 1200 Hz; allowed below 1000 Hz'),
        ({'joint': 'd1'}, r'read-only'),
        ({'kq': 1.0}, r'undeclared'),
    ],
)
def test_gains_with_too_little_margin_are_refused(graph, axis, values, text):
    """They are never applied."""
    node = graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    fresh = [command.voltage for command in axis.run(1)]
    before = node.get_parameter('kp').value
    successful, reason = set_gains(graph, **values)
    assert not successful
    assert re.search(text, reason), reason
    assert node.get_parameter('kp').value == before
    graph.publisher(CycleEvent, 'cycle_events').publish(CycleEvent(event=CycleEvent.RESET, source='machine'))
    graph.spin_in_silence()
    axis.load(2)
    assert [command.voltage for command in axis.run(2)] == fresh


def test_change_of_gains_restarts_learning(graph, axis, learning, machine):
    """The feedforward is kept; the next request has iteration 0 and the new gains."""
    graph.start(JointControllerNode, joint='d3')
    for answer in (1.0, 2.0, 3.0):
        learning.will_answer([answer] * SAMPLES)
    for cycle in (1, 2):
        axis.load(cycle, learning_law='fourier')
        axis.run(cycle)
    graph.spin_until(lambda: len(learning.requests) == 2, 'two requests')
    softer = 0.9 * load_control(machine)['d3'].kp
    assert set_gains(graph, kp=softer) == (True, '')
    axis.load(3, learning_law='fourier')
    assert axis.run(3)[0].feedforward == 2.0
    graph.spin_until(lambda: len(learning.requests) == 3, 'the third request')
    assert [request.iteration for request in learning.requests] == [0, 1, 0]
    asked_with = [gains_from_msg(request.gains, 'request') for request in learning.requests]
    configured = load_control(machine)['d3']
    assert asked_with == [configured, configured, configured.model_copy(update={'kp': softer})]


def test_feedforward_of_other_gains_is_refused(graph, axis):
    """A feedforward saved for the configured gains is refused after a change of gains."""
    graph.start(JointControllerNode, joint='d3')
    assert set_gains(graph, ki=0.0)[0]
    message = axis.message(1)
    message.feedforward = array('d', [0.0] * (SAMPLES * 4))
    axis.send(message)
    assert 'they have been changed since' in graph.next_event(CycleEvent.REFUSED, cycle=1).message
