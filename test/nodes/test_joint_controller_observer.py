"""The joint controller under the observer law: commands of the core, exchange of weights, learning; no machine."""

import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from pkm_core.control.forces import coupling_voltage
from pkm_core.control.model import load_model
from pkm_core.control.observer import ObserverController, load_observer
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.conversions import trajectory_from_msg
from pkm_nodes.nodes.joint_controller import JointControllerNode
from support.axis import SAMPLES, UM

COLUMN = 1  # of d3


@pytest.fixture
def observer(machine, joint_trajectory):
    """Return the law of d3 of the core with the short motion."""
    law = ObserverController(
        load_observer(machine)['d3'], load_model(machine)['d3'], machine.sample_time, machine.voltage_limit
    )
    trajectory = trajectory_from_msg(joint_trajectory(1), coordinates=machine.joints, sample_time=machine.sample_time)
    rows = [values[:, COLUMN] for values in trajectory.derivatives()]
    law.load(*rows, np.zeros(SAMPLES), coupling_voltage(machine, trajectory, COLUMN))
    return law


def set_parameter(graph, name, value):
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return graph.call(SetParameters, 'joint_controller/set_parameters', request).results[0]


def test_weights_change_in_a_cycle_with_the_bits_of_the_core(graph, axis, observer):
    graph.start(JointControllerNode, joint='d3', control='observer')
    weights = observer.gains.weights.model_copy(update={'speed': 1.1 * observer.gains.weights.speed})
    axis.load(1)
    for index, reference in enumerate(axis.reference):
        if index == 15:
            result = set_parameter(graph, 'speed', weights.speed)
            assert result.successful, result.reason
            observer.exchange(observer.gains.model_copy(update={'weights': weights}))
        axis.sample(1, index, reference - 3 * UM)
        assert axis.answer().voltage == observer.update(index, reference - 3 * UM)[0]


@pytest.mark.parametrize(
    ('name', 'value', 'text'),
    [
        ('force_noise', 10.0, 'the loop'),
        ('effort', -1.0, 'effort: -1.0 given; allowed > 0'),
        ('kp', 1.0, 'undeclared'),
    ],
)
def test_unfit_weights_are_refused_and_the_old_ones_stay(graph, name, value, text):
    node = graph.start(JointControllerNode, joint='d3', control='observer')
    before = node.get_parameter('force_noise').value
    result = set_parameter(graph, name, value)
    assert not result.successful
    assert text in result.reason
    assert node.get_parameter('force_noise').value == before


def test_cycle_with_other_weights_is_not_learned_with_a_notice(graph, axis, learning, machine):
    """The learning node has the weights of the configuration."""
    graph.start(JointControllerNode, joint='d3', control='observer')
    learning.will_answer([0.1] * SAMPLES)
    axis.load(1, learning_law='inverse')
    axis.run(1)
    graph.spin_until(lambda: len(learning.requests) == 1, 'a request')
    assert not learning.requests[0].has_gains
    events = graph.listen(CycleEvent, 'cycle_events')
    speed = load_observer(machine)['d3'].weights.speed
    assert set_parameter(graph, 'speed', 1.1 * speed).successful
    axis.load(2, learning_law='inverse')
    axis.run(2)
    graph.spin_until(lambda: [each for each in events if each.event == CycleEvent.NOTICE], 'a notice')
    notice = next(each for each in events if each.event == CycleEvent.NOTICE)
    assert notice.message == 'd3: nothing is learned with weights that differ from those of the configuration'
    assert len(learning.requests) == 1
