"""One joint controller; the test stands in the place of the machine and of the learning service."""

import math
import re
from array import array

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.exceptions import ParameterException
from rclpy.parameter import Parameter
from rclpy.task import Future

from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController, load_control
from pkm_core.errors import PkmError
from pkm_core.metrics import axis_metrics
from pkm_interfaces.msg import CycleEvent, CycleMetrics, EncoderSample, MotorCommand, SampledTrajectory
from pkm_interfaces.srv import UpdateFeedforward
from pkm_nodes import axis_learning, controller
from pkm_nodes.gains import gains_from_msg
from pkm_nodes.joint_controller import JointControllerNode
from pkm_nodes.node import LAST_VALUE_QOS

UM = 1e-6
SAMPLES = 40  # of the short motion


class Axis:
    """The test in the place of the machine's axis d3."""

    column = 1

    def __init__(self, graph, joint_trajectory):
        self._graph = graph
        self.message = joint_trajectory
        self._trajectories = graph.publisher(SampledTrajectory, 'joint_trajectory')
        self._samples = graph.publisher(EncoderSample, 'd3/encoder')
        self.commands = graph.listen(MotorCommand, 'd3/command')
        self.reference = np.array(joint_trajectory(0).position).reshape(SAMPLES, 4)[:, self.column]
        self._tick = 0

    def send(self, trajectory):
        self._trajectories.publish(trajectory)

    def load(self, cycle, **named):
        self.send(self.message(cycle, **named))
        return self._graph.next_event(CycleEvent.LOADED, cycle=cycle)

    def sample(self, cycle, index, position, mode=EncoderSample.RUN):
        self._samples.publish(EncoderSample(tick=self._tick, cycle=cycle, index=index, position=position, mode=mode))
        self._tick += 1

    def answer(self):
        """Return the one command that has come."""
        self._graph.spin_until(lambda: self.commands, 'a command')
        return self.commands.pop()

    def run(self, cycle, error=lambda index: 0.0):
        """Play a whole cycle in which the slider lags by `error` [m]; return the commands."""
        commands = []
        for index, reference in enumerate(self.reference):
            self.sample(cycle, index, reference - error(index))
            commands.append(self.answer())
        return commands


@pytest.fixture
def axis(graph, joint_trajectory):
    return Axis(graph, joint_trajectory)


@pytest.fixture
def law(machine):
    """Return the law of d3 as the core has it, with the short motion to be loaded."""
    return RobustController(
        load_control(machine)['d3'], load_model(machine)['d3'], machine.sample_time, machine.voltage_limit
    )


class Learning:
    """The test in the place of the learning service: notes the requests and gives the answers it is told to."""

    def __init__(self, graph):
        self.requests = []
        self.answers = []
        graph.node.create_service(UpdateFeedforward, 'learning/update', self._on_update)

    def _on_update(self, request, response):
        self.requests.append(request)
        response.success, response.message, response.feedforward = self.answers.pop(0)
        return response

    def will_answer(self, feedforward):
        self.answers.append((True, '', array('d', feedforward)))

    def will_refuse(self, message):
        self.answers.append((False, message, array('d')))


@pytest.fixture
def learning(graph):
    return Learning(graph)


def feedforward_of(commands):
    return [command.feedforward for command in commands]


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
    axis.load(5)  # sent again, reported again: the machine may have come up late


def test_trajectory_is_loaded_only_when_somebody_takes_the_commands(graph, joint_trajectory):
    graph.start(JointControllerNode, joint='d3')
    graph.publisher(SampledTrajectory, 'joint_trajectory').publish(joint_trajectory(1))
    graph.spin_in_silence()
    assert not graph.events
    graph.listen(MotorCommand, 'd3/command')
    graph.next_event(CycleEvent.LOADED, cycle=1)


def test_reader_of_the_commands_that_cannot_connect_holds_up_a_cycle_for_a_while_only(graph, axis, monkeypatch):
    monkeypatch.setattr(controller, 'DISCOVERY', 0.5)
    graph.start(JointControllerNode, joint='d3')
    graph.node.create_subscription(MotorCommand, 'd3/command', print, LAST_VALUE_QOS)  # wants what is not offered
    graph.spin_until(lambda: graph.node.count_subscribers('d3/command') == 2, 'the second reader to be known')
    axis.send(axis.message(1))
    graph.spin_in_silence()
    assert not graph.events
    graph.next_event(CycleEvent.LOADED, cycle=1)


def test_every_tick_is_answered_with_the_voltage_of_the_law_and_reference_minus_measured(
    graph, axis, law, joint_trajectory
):
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


def test_samples_of_another_cycle_or_of_a_safe_stop_are_not_answered(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    axis.sample(2, 0, 0.14)
    axis.sample(1, 0, 0.14)
    assert axis.answer().tick == 1
    axis.sample(1, 1, 0.14, EncoderSample.SAFE_STOP)
    axis.sample(1, 1, 0.14)
    graph.spin_in_silence()
    assert not axis.commands


def test_after_a_safe_stop_the_law_starts_afresh(graph, axis):
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


def test_cycle_that_is_stopped_by_an_event_is_over_also_without_a_machine_that_says_so(graph, axis):
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


def test_after_a_reset_of_the_machine_the_law_starts_afresh_also_without_a_fault(graph, axis):
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


def test_foreign_trajectory_in_the_midst_of_a_cycle_is_refused_and_the_cycle_goes_on(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    fresh = [command.voltage for command in axis.run(1)]
    events = graph.publisher(CycleEvent, 'cycle_events')
    events.publish(CycleEvent(event=CycleEvent.RESET))
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


def test_position_that_is_not_finite_is_not_answered_and_the_next_one_is(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    axis.sample(1, 0, math.nan)
    axis.sample(1, 0, axis.reference[0])
    command = axis.answer()
    assert (command.tick, command.error) == (1, 0.0)
    assert math.isfinite(command.voltage)


def test_index_beyond_the_cycle_is_not_answered(graph, axis):
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
def test_trajectory_that_does_not_fit_is_refused_and_the_next_one_is_loaded(graph, axis, spoil, text):
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


def test_learning_is_asked_after_the_last_tick_and_its_answer_is_the_next_feedforward(graph, axis, learning, machine):
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
    # a lead of zero: loading does not shift the integrator, so the voltages differ by the learned part alone
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


def refuses(learning):
    learning.will_refuse('learning d3: not today')


@pytest.mark.parametrize('fails', [refuses, answers_too_short, answers_nan])
def test_feedforward_stays_when_learning_fails_and_learning_goes_on_from_it(graph, axis, learning, fails):
    graph.start(JointControllerNode, joint='d3')
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
            second.position[4 * row + axis.column] += 10 * UM
    axis.send(second)
    graph.next_event(CycleEvent.LOADED, cycle=2)
    assert feedforward_of(axis.run(2)) == [0.0] * SAMPLES
    graph.spin_until(lambda: len(learning.requests) == 2, 'the second request to learn')
    assert learning.requests[1].iteration == 0
    assert list(learning.requests[1].feedforward) == [0.0] * SAMPLES


def test_cycle_is_loaded_only_when_learning_has_answered(graph, axis):
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


def test_cell_goes_on_without_a_learning_service(graph, axis, monkeypatch):
    monkeypatch.setattr(axis_learning, 'LEARNING_TIMEOUT', 0.2)
    graph.start(JointControllerNode, joint='d3')
    axis.load(1, learning_law='fourier')
    axis.run(1)
    axis.load(2, learning_law='fourier')
    notice = graph.next_event(CycleEvent.NOTICE, cycle=1)
    assert notice.message == 'd3: no answer from learning/update for 0.2 s; going on with the feedforward there is'
    assert feedforward_of(axis.run(2)) == [0.0] * SAMPLES


def test_divergence_is_noticed_within_two_cycles_and_the_best_feedforward_is_driven_again(graph, axis, learning):
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
    assert 'back to the feedforward that left 4.0 um' in notice.message
    graph.spin_until(lambda: any(s.level == DiagnosticStatus.WARN for m in diagnostics for s in m.status), 'a warning')
    assert diagnostics[-1].status[0].message == notice.message
    graph.spin_until(lambda: len(learning.requests) == 5, 'the request of the sixth cycle')
    assert [request.iteration for request in learning.requests] == [0, 1, 2, 3, 0]


def test_feedforward_that_comes_with_the_trajectory_is_driven_and_learned_from(graph, axis, learning):
    graph.start(JointControllerNode, joint='d3')
    learning.will_answer([3.0] * SAMPLES)
    learning.will_answer([4.0] * SAMPLES)
    message = axis.message(1, learning_law='fourier')
    given = np.zeros((SAMPLES, 4))
    given[:, axis.column] = np.linspace(0, 1, SAMPLES)
    message.feedforward = array('d', given.tobytes())
    axis.send(message)
    graph.next_event(CycleEvent.LOADED, cycle=1)
    assert feedforward_of(axis.run(1)) == list(given[:, axis.column])
    axis.load(2, learning_law='fourier')
    assert feedforward_of(axis.run(2)) == [3.0] * SAMPLES
    graph.spin_until(lambda: len(learning.requests) == 2, 'two requests')
    assert list(learning.requests[0].feedforward) == list(given[:, axis.column])
    assert [request.cycle for request in learning.requests] == [1, 2]


@pytest.mark.parametrize(
    ('feedforward', 'text'),
    [
        ([0.0] * (SAMPLES * 4 - 1), '159 feedforward values; expected 40 x 4'),
        ([math.nan] * (SAMPLES * 4), 'not finite'),
    ],
)
def test_feedforward_that_does_not_fit_is_refused(graph, axis, feedforward, text):
    graph.start(JointControllerNode, joint='d3')
    message = axis.message(1)
    message.feedforward = array('d', feedforward)
    axis.send(message)
    assert text in graph.next_event(CycleEvent.REFUSED, cycle=1).message


def set_gains(graph, **values):
    """Set parameters of the controller at once and return (successful, reason)."""
    request = SetParametersAtomically.Request(
        parameters=[
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg() for name, value in values.items()
        ]
    )
    result = graph.call(SetParametersAtomically, 'joint_controller/set_parameters_atomically', request).result
    return result.successful, result.reason


def test_gains_are_changed_in_the_midst_of_a_cycle_without_a_jump(graph, axis, law, joint_trajectory):
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
            law.exchange(other)  # of which test_robust.py says that the voltage does not jump
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
        ({'kp': -1.0}, r'kp: -1.0 given; .*greater than 0'),
        ({'notch__centre': 1200.0}, r'notch: centre is 1200 Hz; allowed below 1000 Hz'),
        ({'joint': 'd1'}, r'read-only'),
        ({'kq': 1.0}, r'undeclared'),
    ],
)
def test_gains_that_leave_too_little_margin_are_refused_before_they_are_applied(graph, axis, values, text):
    node = graph.start(JointControllerNode, joint='d3')
    axis.load(1)
    fresh = [command.voltage for command in axis.run(1)]
    before = node.get_parameter('kp').value
    successful, reason = set_gains(graph, **values)
    assert not successful
    assert re.search(text, reason), reason
    assert node.get_parameter('kp').value == before
    graph.publisher(CycleEvent, 'cycle_events').publish(CycleEvent(event=CycleEvent.RESET))
    graph.spin_in_silence()
    axis.load(2)
    assert [command.voltage for command in axis.run(2)] == fresh


def test_after_a_change_of_gains_learning_begins_anew_from_what_there_is_with_the_new_loop(
    graph, axis, learning, machine
):
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


def test_feedforward_of_the_configured_gains_is_refused_by_a_controller_that_has_others(graph, axis):
    graph.start(JointControllerNode, joint='d3')
    assert set_gains(graph, ki=0.0)[0]
    message = axis.message(1)
    message.feedforward = array('d', [0.0] * (SAMPLES * 4))
    axis.send(message)
    assert 'they have been changed since' in graph.next_event(CycleEvent.REFUSED, cycle=1).message


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
def test_parameter_that_cannot_be_is_refused_by_name(graph, parameters, text):
    with pytest.raises(PkmError, match=text):
        graph.start(JointControllerNode, **parameters)


def test_parameter_of_the_wrong_type_is_refused_by_name(graph):
    with pytest.raises(ParameterException, match=r"joint.*'3'.*INTEGER.*STRING"):
        graph.start(JointControllerNode, joint=3)
