"""The controller of all joints; the test replaces the machine."""

import math

import numpy as np
import pytest

from pkm_core.control.computed_torque import load_torque_control
from pkm_core.control.controllers import make_controller
from pkm_core.errors import ConfigError
from pkm_interfaces.msg import CycleEvent, CycleMetrics, EncoderSample, MotorCommand, SampledTrajectory
from pkm_nodes.messages.conversions import trajectory_from_msg
from pkm_nodes.nodes.computed_torque_controller import ComputedTorqueControllerNode

JOINTS = ('d1', 'd3', 'd5', 'd7')
UM = 1e-6


class Cell:
    """Replacement of the machine."""

    def __init__(self, graph, joint_trajectory, machine):
        self._graph, self.message = graph, joint_trajectory
        self._trajectories = graph.publisher(SampledTrajectory, 'joint_trajectory')
        self._encoders = [graph.publisher(EncoderSample, f'{joint}/encoder') for joint in JOINTS]
        self.commands = [graph.listen(MotorCommand, f'{joint}/command') for joint in JOINTS]
        self.reference = trajectory_from_msg(
            joint_trajectory(1), coordinates=machine.joints, sample_time=machine.sample_time
        )
        self._tick = 0

    def send(self, message):
        self._trajectories.publish(message)

    def load(self, cycle):
        self.send(self.message(cycle))
        for joint in JOINTS:
            assert self._graph.next_event(CycleEvent.LOADED, cycle=cycle, source=joint).samples == len(self.reference)

    def sample(self, cycle, index, positions, mode=EncoderSample.RUN):
        """Send the samples of a tick, without those of position None."""
        for encoder, position in zip(self._encoders, positions, strict=True):
            if position is not None:
                encoder.publish(
                    EncoderSample(tick=self._tick, cycle=cycle, index=index, position=float(position), mode=mode)
                )
        self._tick += 1

    def answer(self):
        self._graph.spin_until(lambda: all(self.commands), 'a command for every joint')
        return [commands.pop() for commands in self.commands]

    def run(self, cycle, lag=0.0):
        """Play a cycle with lagging sliders; return the commands, one row per tick."""
        rows = []
        for index, reference in enumerate(self.reference.position):
            self.sample(cycle, index, reference - lag)
            rows.append(self.answer())
        return rows


@pytest.fixture
def cell(graph, joint_trajectory, machine):
    return Cell(graph, joint_trajectory, machine)


def voltages(rows):
    return [[command.voltage for command in row] for row in rows]


def test_commands_have_the_voltages_of_the_law_of_the_core(graph, cell, machine):
    """Every tick gets one command per joint."""
    graph.start(ComputedTorqueControllerNode)
    law = make_controller(machine, load_torque_control(machine))
    law.load(cell.reference, np.zeros_like(cell.reference.position))
    cell.load(1)
    lag = UM * np.array([1.0, -2.0, 3.0, 0.0])
    for index, row in enumerate(cell.run(1, lag)):
        voltage, error = law.update(index, cell.reference.position[index] - lag)
        assert [(command.tick, command.cycle) for command in row] == [(index, 1)] * 4
        assert [command.voltage for command in row] == list(voltage)
        assert [command.error for command in row] == list(error)
        assert [command.feedforward for command in row] == [0.0] * 4


def test_incomplete_tick_gets_no_command(graph, cell):
    """The samples of the next tick do not complete it."""
    graph.start(ComputedTorqueControllerNode)
    cell.load(1)
    home = cell.reference.position[0]
    cell.sample(1, 0, [*home[:3], None])
    graph.spin_in_silence()
    assert not any(cell.commands)
    cell.sample(1, 0, home)  # the next tick does not complete it
    assert [command.tick for command in cell.answer()] == [1] * 4


def test_non_finite_position_gets_no_command(graph, cell):
    """The next finite one does."""
    graph.start(ComputedTorqueControllerNode)
    cell.load(1)
    home = cell.reference.position[0]
    cell.sample(1, 0, [home[0], math.nan, home[2], home[3]])
    graph.spin_in_silence()
    assert not any(cell.commands)
    cell.sample(1, 0, home)
    assert [command.tick for command in cell.answer()] == [1] * 4


def test_metrics_of_every_joint_follow_the_last_tick(graph, cell):
    graph.start(ComputedTorqueControllerNode)
    metrics = [graph.listen(CycleMetrics, f'{joint}/cycle_metrics') for joint in JOINTS]
    cell.load(1)
    cell.run(1, UM * np.array([1.0, 2.0, 3.0, 4.0]))
    graph.spin_until(lambda: all(metrics), 'the metrics of every joint')
    for number, (joint, (found,)) in enumerate(zip(JOINTS, metrics, strict=True), start=1):
        assert (found.joint, found.cycle) == (joint, 1)
        assert found.max_dynamic_error == pytest.approx(number * UM)


def test_following_error_of_one_joint_stops_all(graph, cell):
    graph.start(ComputedTorqueControllerNode)
    cell.load(1)
    cell.sample(1, 0, cell.reference.position[0] - UM * np.array([0.0, 1010.0, 0.0, 0.0]))
    stop = graph.next_event(CycleEvent.STOP, cycle=1)
    assert (stop.source, stop.message[:34]) == ('d3', 'd3: following error is 1.010 mm; a')
    graph.spin_in_silence()
    assert not any(cell.commands)


@pytest.mark.parametrize('stop', ['safe stop', 'reset'])
def test_safe_stop_and_reset_reset_the_law(graph, cell, stop):
    graph.start(ComputedTorqueControllerNode)
    events = graph.publisher(CycleEvent, 'cycle_events')
    cell.load(1)
    fresh = voltages(cell.run(1))
    cell.load(2)
    cell.run(2, 20 * UM)  # fills the integrators
    if stop == 'reset':
        events.publish(CycleEvent(event=CycleEvent.RESET, source='machine'))
    else:
        cell.sample(2, 39, cell.reference.position[39], EncoderSample.SAFE_STOP)
    graph.spin_in_silence()
    cell.load(3)
    assert voltages(cell.run(3)) == fresh


def test_trajectory_with_a_learning_law_is_refused(graph, cell):
    graph.start(ComputedTorqueControllerNode)
    cell.send(cell.message(4, learning_law='fourier'))
    refused = graph.next_event(CycleEvent.REFUSED, cycle=4)
    assert "learning_law 'fourier': computed torque learns nothing; expected none" in refused.message
    cell.load(5)


def test_cycle_of_identification_is_refused(graph, cell):
    graph.start(ComputedTorqueControllerNode)
    cell.send(cell.message(4, kind=SampledTrajectory.IDENTIFICATION))
    refused = graph.next_event(CycleEvent.REFUSED, cycle=4)
    assert refused.message == 'kind IDENTIFICATION: computed torque takes no excitation; expected MOTION'


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'control': 'four_dof_thesis'}, r"'four_dof_thesis' is for robust; this node is for computed_torque"),
        ({'joint': 'd1'}, r"computed_torque_controller has unknown parameter\(s\) \['joint'\]"),
    ],
)
def test_invalid_parameter_is_refused_by_name(graph, parameters, text):
    with pytest.raises(ConfigError, match=text):
        graph.start(ComputedTorqueControllerNode, **parameters)
