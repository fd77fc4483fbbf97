"""One joint controller: loading of a cycle, commands, reset; the test replaces the machine."""

import math

import numpy as np
import pytest

from pkm_core.errors import ConfigError, PkmError
from pkm_core.motion.metrics import axis_metrics
from pkm_interfaces.msg import CycleEvent, CycleMetrics, EncoderSample, MotorCommand, SampledTrajectory
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.parts import cycle_controller
from pkm_nodes.runtime.node import LAST_VALUE_QOS
from support.axis import SAMPLES, UM


def test_controller_is_silent_before_a_trajectory(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    axis.sample(1, 0, 0.14)
    graph.spin_in_silence()
    assert not axis.commands
    assert not graph.events


def test_loaded_trajectory_is_reported_with_its_length(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    loaded = axis.load(5)
    assert (loaded.source, loaded.cycle, loaded.samples) == ('d3', 5, SAMPLES)
    axis.load(5)  # resent and reported again, for a machine that started late


def test_trajectory_is_loaded_only_with_a_command_subscriber(graph, joint_trajectory):
    graph.start(JointControllerNode, joint='d3')
    graph.publisher(SampledTrajectory, 'joint_trajectory').publish(joint_trajectory(1))
    graph.spin_in_silence()
    assert not graph.events
    graph.listen(MotorCommand, 'd3/command')
    graph.next_event(CycleEvent.LOADED, cycle=1)


def test_incompatible_subscriber_delays_loading_by_a_timeout(graph, axis, monkeypatch):
    """The QoS it requests is not offered, so it never connects."""
    monkeypatch.setattr(cycle_controller, 'DISCOVERY', 0.5)
    graph.start(JointControllerNode, joint='d3')
    graph.node.create_subscription(
        MotorCommand, 'd3/command', print, LAST_VALUE_QOS
    )  # requests a QoS that is not offered
    graph.spin_until(lambda: graph.node.count_subscribers('d3/command') == 2, 'the second reader to be known')
    axis.send(axis.message(1))
    graph.spin_in_silence()
    assert not graph.events
    graph.next_event(CycleEvent.LOADED, cycle=1)


def test_command_has_voltage_of_the_law_and_position_error(graph, axis, law, joint_trajectory):
    """Every tick gets one command with tick, cycle, voltage, error and feedforward."""
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    message = joint_trajectory(1)
    law.load(
        *(np.array(getattr(message, n)).reshape(-1, 4)[:, 1] for n in ('position', 'velocity', 'acceleration', 'jerk')),
        np.zeros(SAMPLES),
    )
    lag = np.linspace(-3, 7, SAMPLES) * UM
    commands = axis.run(1, lambda index: lag[index])
    for index, command in enumerate(commands):
        measured = axis.reference[index] - lag[index]
        voltage, _ = law.update(index, measured)
        assert (command.tick, command.cycle) == (index, 1)
        assert command.error == axis.reference[index] - measured
        assert command.voltage == voltage
        assert command.feedforward == 0.0


def test_samples_of_other_cycles_and_safe_stops_get_no_command(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    axis.sample(2, 0, 0.14)
    axis.sample(1, 0, 0.14)
    assert axis.answer().tick == 1
    axis.sample(1, 1, 0.14, EncoderSample.SAFE_STOP)
    axis.sample(1, 1, 0.14)
    graph.spin_in_silence()
    assert not axis.commands


def test_safe_stop_resets_the_law(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    fresh = [command.voltage for command in axis.run(1)]
    axis.load(2)
    axis.sample(2, 0, axis.reference[0] - 50 * UM)
    axis.answer()
    axis.sample(2, 1, axis.reference[0] - 400 * UM, EncoderSample.SAFE_STOP)
    graph.spin_in_silence()
    axis.load(3)
    assert [command.voltage for command in axis.run(3)] == fresh


def test_following_error_beyond_the_limit_stops_the_machine(graph, axis):
    graph.start(JointControllerNode, joint='d3', following_error_limit=3e-4)
    axis.load(1)
    axis.sample(1, 0, axis.reference[0] - 290 * UM)
    axis.answer()
    axis.sample(1, 1, axis.reference[1] + 310 * UM)
    stop = graph.next_event(CycleEvent.STOP, source='d3', cycle=1)
    assert stop.message == (
        'd3: following error is -0.310 mm; allowed: at most 0.3 mm (parameter following_error_limit)'
    )
    graph.spin_in_silence()
    assert not axis.commands


def test_stop_event_ends_the_running_cycle(graph, axis):
    """A STOP of another cycle has no effect; no event of the machine is needed."""
    graph.start(JointControllerNode, joint='d3')
    events = graph.publisher(CycleEvent, 'cycle_events')
    axis.load(1)
    fresh = [command.voltage for command in axis.run(1)]
    axis.load(2)
    axis.sample(2, 0, axis.reference[0] - 50 * UM)
    axis.answer()
    for cycle in (7, 2):  # the first one is not the running cycle
        events.publish(CycleEvent(event=CycleEvent.STOP, source='somebody', cycle=cycle))
        graph.next_event(CycleEvent.STOP, cycle=cycle)
        axis.send(axis.message(3))
        answer = graph.next_event(CycleEvent.REFUSED if cycle == 7 else CycleEvent.LOADED)
        assert answer.cycle == 3
    assert [command.voltage for command in axis.run(3)] == fresh


def test_reset_of_the_machine_resets_the_law(graph, axis):
    """Also without a preceding fault."""
    graph.start(JointControllerNode, joint='d3')
    events = graph.publisher(CycleEvent, 'cycle_events')
    axis.load(1)
    fresh = [command.voltage for command in axis.run(1)]
    axis.load(2)
    axis.run(2, lambda index: 20 * UM)  # fills the integrator
    axis.load(3)
    assert axis.run(3)[0].voltage != fresh[0]
    events.publish(CycleEvent(event=CycleEvent.RESET, source='machine', cycle=3))
    graph.spin_in_silence()
    axis.load(4)
    assert [command.voltage for command in axis.run(4)] == fresh


def test_trajectory_of_another_cycle_is_refused_while_one_runs(graph, axis):
    """The running cycle continues with unchanged voltages."""
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    fresh = [command.voltage for command in axis.run(1)]
    events = graph.publisher(CycleEvent, 'cycle_events')
    events.publish(CycleEvent(event=CycleEvent.RESET, source='machine'))
    graph.spin_in_silence()
    axis.load(2)
    voltages = []
    for index, reference in enumerate(axis.reference):
        axis.sample(2, index, reference)
        voltages.append(axis.answer().voltage)
        if index == 7:
            axis.send(axis.message(9, motion='other'))
            refused = graph.next_event(CycleEvent.REFUSED, cycle=9)
            assert 'trajectory of cycle 9: cycle 2 is running' in refused.message
    assert voltages == fresh
    axis.load(3)


def test_non_finite_position_gets_no_command(graph, axis):
    """The next finite position does."""
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    axis.sample(1, 0, math.nan)
    axis.sample(1, 0, axis.reference[0])
    command = axis.answer()
    assert (command.tick, command.error) == (1, 0.0)
    assert math.isfinite(command.voltage)


def test_index_beyond_the_cycle_gets_no_command(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    axis.sample(1, SAMPLES, axis.reference[0])
    axis.sample(1, 0, axis.reference[0])
    assert axis.answer().tick == 1


def with_nan(message):
    message.velocity[4 * 7 + 2] = math.nan


def with_a_row_missing(message):
    message.jerk = message.jerk[:-4]


def with_a_value_missing(message):
    message.position = message.position[:-1]


def with_poses(message):
    message.coordinates = ['x', 'y', 'z', 'phi']


def at_1_khz(message):
    message.sample_time = 1e-3


def with_a_move_beyond_the_end(message):
    message.move_ends[-1] = SAMPLES


@pytest.mark.parametrize(
    ('spoil', 'text'),
    [
        (with_nan, 'velocity of d5 at sample 7 is nan; expected a finite number'),
        (with_a_row_missing, 'jerk has shape (39, 4); expected (40, 4)'),
        (with_a_value_missing, '159 position values; expected a multiple of 4 columns'),
        (with_poses, "has coordinates ['x', 'y', 'z', 'phi']; expected ['d1', 'd3', 'd5', 'd7']"),
        (at_1_khz, 'has a sample time of 0.001 s; expected 0.0005 s'),
        (with_a_move_beyond_the_end, 'moves from samples [2, 22] to [12, 40]; expected'),
    ],
)
def test_invalid_trajectory_is_refused_and_the_next_one_loaded(graph, axis, spoil, text):
    graph.start(JointControllerNode, joint='d3')
    message = axis.message(2)
    spoil(message)
    axis.send(message)
    refused = graph.next_event(CycleEvent.REFUSED)
    assert (refused.source, refused.cycle) == ('d3', 2)
    assert 'cycle 2: ' in refused.message
    assert text in refused.message
    axis.load(3)
    axis.run(3)


def test_metrics_of_a_cycle_are_those_of_its_errors(graph, axis, machine):
    graph.start(JointControllerNode, joint='d3')
    metrics = graph.listen(CycleMetrics, 'd3/cycle_metrics')
    axis.load(1)
    commands = axis.run(1, lambda index: 3 * UM if index == 30 else 0.1 * UM)
    graph.spin_until(lambda: metrics, 'the metrics of the cycle')
    message = axis.message(1)
    expected = axis_metrics([c.error for c in commands], message.move_starts, message.move_ends, machine.sample_time)
    assert (metrics[0].cycle, metrics[0].joint) == (1, 'd3')
    for name in ('max_dynamic_error', 'settling_time_5um', 'settling_time_1um', 'steady_state_error'):
        assert getattr(metrics[0], name) == getattr(expected, name)


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'joint': 'd2'}, r"joint 'd2'; four_dof has \['d1', 'd3', 'd5', 'd7'\]"),
        ({'jiont': 'd3'}, r"/pkm/joint_controller has unknown parameter\(s\) \['jiont'\]; known: .*'joint'"),
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown; .*'planar'"),
        ({'control': 'soft'}, r"control: 'soft' is unknown; .*'four_dof'"),
        ({'control': 'computed_torque'}, r"control 'computed_torque' is for computed_torque; this node is for robust"),
        ({'kp': 60000.0}, r'joint_controller: the loop is unstable'),
        ({'least_gain_margin': math.nan}, r'least_gain_margin is nan; expected a positive, finite number'),
    ],
)
def test_invalid_parameter_is_refused_by_name(graph, parameters, text):
    with pytest.raises(PkmError, match=text):
        graph.start(JointControllerNode, **parameters)


def test_parameter_of_the_wrong_type_is_refused_by_name(graph):
    with pytest.raises(ConfigError, match=r'joint is 3 \(integer\); expected string'):
        graph.start(JointControllerNode, joint=3)
