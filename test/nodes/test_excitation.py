"""An identification cycle of the nodes: excitation, excited voltage, and the stop outside the bounds."""

from array import array

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController, load_control
from pkm_core.identification.bag_data import read_cell_bag
from pkm_core.identification.plan import in_poses
from pkm_core.motion.planning import Motion, Target, plan
from pkm_core.motion.trajectory import to_joints
from pkm_interfaces.action import Identify
from pkm_interfaces.msg import CycleEvent, CycleMetrics, EncoderSample, Excitation, MotorCommand, SampledTrajectory
from pkm_nodes.messages.conversions import trajectory_to_msg
from pkm_nodes.nodes.identification import IdentificationNode
from pkm_nodes.nodes.inverse_kinematics import InverseKinematicsNode
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.nodes.recorder import RecorderNode
from pkm_nodes.nodes.state_estimator import StateEstimatorNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode

JOINTS = ('d1', 'd3', 'd5', 'd7')
COLUMN = 1  # d3


@pytest.fixture(scope='module')
def joints(machine):
    """Return a joint trajectory of 200 samples."""
    motion = Motion(
        machine=machine.name,
        targets=[Target(by={'d3': 2e-4})],
        lead_rest=10e-3,
        move_time=30e-3,
        settle_window=10e-3,
    )
    return to_joints(machine, plan(machine, motion))


@pytest.fixture(scope='module')
def volts(joints):
    """Return an excitation [V] of d3."""
    return 0.5 * np.sin(2 * np.pi * 100 * 5e-4 * np.arange(len(joints)))


def excitations(volts, cycle=0):
    quiet = np.zeros(volts.size)
    return [
        Excitation(cycle=cycle, joint=joint, voltage=array('d', volts if joint == 'd3' else quiet)) for joint in JOINTS
    ]


class Cycle:
    """Replacement of the trajectory generator and the machine's axis d3."""

    def __init__(self, graph, joints):
        self._graph, self._joints = graph, joints
        self._trajectories = graph.publisher(SampledTrajectory, 'joint_trajectory')
        self._excitations = graph.publisher(Excitation, 'excitation')
        self._samples = graph.publisher(EncoderSample, 'd3/encoder')
        self.commands = graph.listen(MotorCommand, 'd3/command')

    def plan(self, cycle, **fields):
        named = {'cycle': cycle, 'motion': 'd3_sweep_0', 'kind': SampledTrajectory.IDENTIFICATION}
        self._trajectories.publish(trajectory_to_msg(self._joints, **named, **fields))

    def excite(self, cycle, volts):
        for message in excitations(volts, cycle):
            self._excitations.publish(message)

    def sample(self, cycle, index, position):
        self._samples.publish(EncoderSample(tick=index, cycle=cycle, index=index, position=position))

    def answer(self):
        self._graph.spin_until(lambda: self.commands, 'a command')
        return self.commands.pop()


@pytest.fixture
def cycle(graph, joints):
    return Cycle(graph, joints)


def test_controller_waits_for_the_excitation_of_the_cycle(graph, cycle, volts):
    graph.start(JointControllerNode, joint='d3')
    cycle.excite(3, volts)
    cycle.plan(4)
    graph.spin_in_silence()
    assert not graph.events
    cycle.excite(4, volts)
    loaded = graph.next_event(CycleEvent.LOADED)
    assert (loaded.source, loaded.cycle, loaded.samples) == ('d3', 4, volts.size)


def test_excitation_is_added_to_the_voltage_of_the_law(graph, machine, cycle, joints, volts):
    graph.start(JointControllerNode, joint='d3')
    cycle.excite(1, volts)
    cycle.plan(1)
    graph.next_event(CycleEvent.LOADED)
    law = RobustController(
        load_control(machine)['d3'], load_model(machine)['d3'], machine.sample_time, machine.voltage_limit
    )
    law.load(*(rows[:, COLUMN] for rows in joints.derivatives()), np.zeros(volts.size))
    for index in range(volts.size):
        position = joints.position[index, COLUMN] - 1e-6
        cycle.sample(1, index, position)
        voltage, error = law.update(index, position)
        command = cycle.answer()
        assert (command.voltage, command.error) == (voltage + volts[index], error)


def test_cycle_of_identification_is_not_learned(graph, cycle, learning, joints, volts):
    graph.start(JointControllerNode, joint='d3')
    metrics = graph.listen(CycleMetrics, 'd3/cycle_metrics')
    cycle.excite(1, volts)
    cycle.plan(1, learning_law='fourier')
    graph.next_event(CycleEvent.LOADED)
    for index in range(volts.size):
        cycle.sample(1, index, joints.position[index, COLUMN])
        cycle.answer()
    graph.spin_until(lambda: metrics, 'the metrics of the cycle')
    graph.spin_in_silence()
    assert not learning.requests


def test_axis_outside_its_bounds_requests_a_stop(graph, cycle, joints, volts):
    """The sample gets no command."""
    graph.start(JointControllerNode, joint='d3')
    cycle.excite(1, volts)
    cycle.plan(1)
    graph.next_event(CycleEvent.LOADED)
    cycle.sample(1, 0, joints.position[0, COLUMN] + 1.5e-3)
    stop = graph.next_event(CycleEvent.STOP)
    assert (stop.source, stop.cycle) == ('d3', 1)
    assert stop.message == 'sample 0: d3 is 1.500 mm off its reference; allowed 1 mm'
    assert not cycle.commands


def test_excitation_of_the_wrong_length_is_refused(graph, cycle, volts):
    graph.start(JointControllerNode, joint='d3')
    cycle.excite(1, volts[:-1])
    cycle.plan(1)
    refused = graph.next_event(CycleEvent.REFUSED, cycle=1)
    assert refused.message == 'excitation of d3: 199 values; expected one per sample, 200'


def test_inverse_kinematics_ignores_cycles_planned_in_joints(graph, machine, joints):
    graph.start(InverseKinematicsNode)
    sent = graph.listen(SampledTrajectory, 'joint_trajectory')
    poses = graph.publisher(SampledTrajectory, 'pose_trajectory')
    trajectory = in_poses(machine, joints)
    poses.publish(trajectory_to_msg(trajectory, cycle=1, motion='sweep', kind=SampledTrajectory.IDENTIFICATION))
    poses.publish(trajectory_to_msg(trajectory, cycle=2, motion='move'))
    graph.spin_until(lambda: sent, 'a joint_trajectory')
    assert [message.cycle for message in sent] == [2]


def send(goals, joints, excitation, **fields):
    """Return the handle of a goal of one identification cycle."""
    experiment = trajectory_to_msg(joints, cycle=0, motion='d3_sweep_0')
    return goals.send(**{'experiment': experiment, 'excitation': excitation} | fields)


def end(goals, handle):
    status, result = goals.result(handle)
    return status, result.message


@pytest.fixture
def cell(graph, tmp_path):
    """Start a cell of real nodes without display and learning."""
    graph.start(MachineNode, wait_for_recorder=True)
    for joint in JOINTS:
        graph.start(JointControllerNode, joint=joint)
    for node_type in (TrajectoryGeneratorNode, InverseKinematicsNode, StateEstimatorNode):
        graph.start(node_type)
    graph.start(RecorderNode, folder=str(tmp_path))


def test_experiment_is_one_cycle_recorded_with_its_excitation(graph, cell, goals, machine, joints, volts):
    result = send(goals, joints, excitations(volts))
    recorded = graph.next_event(CycleEvent.RECORDED)
    assert end(goals, result) == (GoalStatus.STATUS_SUCCEEDED, '')
    record, warnings = read_cell_bag(machine, recorded.bag)
    assert not warnings
    assert np.array_equal(record.reference, joints.position)
    assert np.array_equal(record.excitation[:, COLUMN], volts)
    assert not np.delete(record.excitation, COLUMN, axis=1).any()


def test_stop_of_the_running_cycle_brakes_the_machine_at_once(graph, cell, goals, joints, volts):
    events = graph.publisher(CycleEvent, 'cycle_events')
    result = send(goals, joints, excitations(volts))
    graph.next_event(CycleEvent.STARTED, cycle=1)
    events.publish(CycleEvent(event=CycleEvent.STOP, source='somebody', cycle=1, message='enough'))
    fault = graph.next_event(CycleEvent.FAULT)
    assert fault.message == 'somebody: enough'
    assert end(goals, result) == (GoalStatus.STATUS_ABORTED, 'machine: somebody: enough')


def test_stop_of_another_cycle_has_no_effect(graph, cell, goals, joints, volts):
    events = graph.publisher(CycleEvent, 'cycle_events')
    result = send(goals, joints, excitations(volts))
    graph.next_event(CycleEvent.STARTED, cycle=1)
    events.publish(CycleEvent(event=CycleEvent.STOP, source='somebody', cycle=7, message='enough'))
    assert end(goals, result) == (GoalStatus.STATUS_SUCCEEDED, '')


@pytest.mark.parametrize(
    ('excited', 'fields', 'reason'),
    [
        (JOINTS[:3], {}, "goal: excitation of ['d1', 'd3', 'd5']; expected one of each of ['d1', 'd3', 'd5', 'd7']"),
        (
            JOINTS,
            {'learning_law': 'fourier'},
            "goal: learning_law 'fourier', move_time 0.0 s and stay False",
        ),
        (JOINTS, {'motion': 'four_dof_70ms'}, "motion 'four_dof_70ms', 0 poses and experiment 'd3_sweep_0'; give one"),
    ],
)
def test_invalid_experiment_is_refused(graph, goals, joints, volts, excited, fields, reason):
    graph.start(TrajectoryGeneratorNode)
    given = [each for each in excitations(volts) if each.joint in excited]
    status, message = end(goals, send(goals, joints, given, **fields))
    assert status == GoalStatus.STATUS_ABORTED
    assert reason in message


def test_cancelled_identification_brakes_the_machine(graph, cell, machine, tmp_path):
    """The bag of the cycle is readable."""
    graph.start(IdentificationNode, folder=str(tmp_path / 'identified'))
    client = ActionClient(graph.node, Identify, 'identify')
    graph.spin_until(client.server_is_ready, 'the action server')
    sent = client.send_goal_async(Identify.Goal(joints=['d3']))
    graph.spin_until(sent.done, 'the acceptance of the goal')
    graph.next_event(CycleEvent.STARTED)
    moved = graph.listen(EncoderSample, 'd3/encoder')
    graph.spin_until(lambda: moved and abs(moved[-1].position - moved[0].position) > 1e-3, 'the first millimetre')
    sent.result().cancel_goal_async()
    fault = graph.next_event(CycleEvent.FAULT)
    assert fault.message == 'identification: identification was cancelled'
    result = sent.result().get_result_async()
    graph.spin_until(result.done, 'the result')
    assert result.result().status == GoalStatus.STATUS_CANCELED
    assert result.result().result.message == f'd3_slow_moves: machine: {fault.message}'
    graph.spin_until(lambda: moved[-1].tick == fault.tick - 1, 'the last tick of the safe stop')
    assert abs(moved[-1].counts - moved[-50].counts) <= 2  # at rest to within the noise of the encoder
    recorded = graph.next_event(CycleEvent.RECORDED)
    record, warnings = read_cell_bag(machine, recorded.bag)
    assert 100 <= len(record.counts) < 7000
    assert 'the rest is missing' in warnings[0]
    client.destroy()
