"""State of a machine that stands: the machine reports its motors, the state_estimator the whole state, latched."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pkm_core.machines.description import joint_positions
from pkm_core.recording.topics import STATES_EVERY, is_at_standstill
from pkm_interfaces.msg import CycleEvent, EncoderSample, Standing
from pkm_nodes.messages.conversions import nanoseconds_of_standstill
from pkm_nodes.messages.diagnostics import node_of, values_of
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.nodes.state_estimator import StateEstimatorNode
from pkm_nodes.runtime.node import LAST_VALUE_QOS, reliable

TICK = 500_000  # ns


class StandingMachine:
    """Replacement of a machine that stands."""

    def __init__(self, graph, machine):
        self._joints = machine.joints
        self._publisher = graph.publisher(Standing, 'machine/standing', LAST_VALUE_QOS)

    def send(self, tick, positions, names=None):
        position = [float(each) for each in positions]
        self._publisher.publish(Standing(tick=tick, joints=list(names or self._joints), position=position))


@pytest.mark.parametrize('tick', [0, 1, 2, 20, 4001])
def test_stamp_at_standstill_is_that_of_no_tick(tick):
    time = nanoseconds_of_standstill(tick, 0.5e-3)
    assert is_at_standstill(time, TICK)
    assert time == pytest.approx(TICK * tick, abs=TICK / 2)
    assert time >= 0
    assert not is_at_standstill(TICK * tick, TICK)


def test_standing_machine_reports_its_motors_again_and_again(graph, machine):
    heard = graph.listen(Standing, 'machine/standing')
    graph.start(MachineNode)
    graph.spin_until(lambda: len(heard) >= 3, 'three reports')
    assert tuple(heard[0].joints) == machine.joints
    # the encoders of the nominal environment read to one count
    assert heard[0].position == pytest.approx(machine.home, abs=machine.encoder_resolution)
    assert len({each.tick for each in heard}) == 1, 'simulated time stands'


def test_moving_machine_reports_no_standstill(graph, controllers):
    """The next report is that of the end of the cycle, with the next tick."""
    graph.start(MachineNode)
    controllers.load(1, 10)
    graph.next_event(CycleEvent.STARTED)
    heard = graph.listen(Standing, 'machine/standing')
    graph.spin_in_silence()
    assert not heard
    for tick in range(10):
        controllers.wait_for(tick)
        controllers.answer(tick, 0.0)
    graph.spin_until(lambda: heard, 'the report after the cycle')
    assert (heard[0].cycle, heard[0].tick) == (1, 10)


def test_reset_reports_the_machine_at_home(graph, controllers, machine):
    graph.start(MachineNode)
    controllers.load(1, 200)
    for tick in range(30):
        controllers.wait_for(tick)
        controllers.answer(tick, 5.0)
    heard = graph.listen(Standing, 'machine/standing')
    graph.call(Trigger, 'machine/stop')
    graph.spin_until(lambda: heard, 'the report after the stop')
    assert np.abs(np.array(heard[-1].position) - machine.home).max() > 1e-4
    graph.call(Trigger, 'machine/reset')
    graph.spin_until(lambda: np.allclose(heard[-1].position, machine.home, atol=1e-6), 'the report at home')


def test_late_subscriber_has_the_state_of_an_idle_cell(graph, machine):
    """It asks for the last value, and gets it although nothing is published any more."""
    machine_node = graph.start(MachineNode)
    graph.start(StateEstimatorNode)
    poses = graph.listen(PoseStamped, 'pose')
    graph.spin_until(lambda: len(poses) >= 2, 'poses')
    graph.stop(machine_node)
    latched = {
        kind: graph.listen(kind, topic, LAST_VALUE_QOS)
        for kind, topic in ((PoseStamped, 'pose'), (JointState, 'joint_states'))
    }
    graph.spin_until(lambda: all(latched.values()), 'the last pose and joint states')
    pose, joints = (messages[-1] for messages in latched.values())
    expected = joint_positions(machine, joints.position[: len(machine.joints)])
    assert dict(zip(joints.name, joints.position, strict=True)) == expected
    assert list(joints.velocity) == len(joints.name) * [0.0]
    x, y, z, _ = machine.forward(np.array(joints.position[: len(machine.joints)]))
    assert (pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) == (x, y, z)


def test_diagnostics_of_a_standing_machine_are_latched(graph):
    graph.start(MachineNode)
    latched = graph.listen(DiagnosticArray, '/diagnostics', LAST_VALUE_QOS)
    graph.spin_until(lambda: len(latched) >= 3, 'three diagnostics')
    status = latched[0].status[0]
    assert (status.name, node_of(status)) == ('/pkm/machine: state', '/pkm/machine')
    assert status.hardware_id == 'four_dof, seed 1, environment nominal'
    values = values_of(status)
    assert (values['late answers'], values['tick rate [1/s]']) == ('0', '0')


def test_volatile_subscriber_is_served_as_before(graph, machine):
    graph.start(StateEstimatorNode)
    poses = graph.listen(PoseStamped, 'pose', QoSProfile(depth=1))
    StandingMachine(graph, machine).send(0, machine.home)
    graph.spin_until(lambda: poses, 'a pose')


def test_state_at_standstill_leaves_speeds_of_a_cycle_alone(graph, machine):
    """The mean speed of the first state after a rest is what it is without the rest: bags keep their bits."""
    graph.start(StateEstimatorNode)
    joints, twists = graph.listen(JointState, 'joint_states'), graph.listen(TwistStamped, 'twist')
    encoders = [graph.publisher(EncoderSample, f'{joint}/encoder') for joint in machine.joints]
    standing = StandingMachine(graph, machine)
    for count, (tick, offset) in enumerate(((0, 0.0), (STATES_EVERY, 1e-4)), start=1):
        for publisher, position in zip(encoders, machine.home + offset, strict=True):
            publisher.publish(EncoderSample(tick=tick, position=float(position)))
        graph.spin_until(lambda count=count: len(joints) == 2 * count - 1, 'a state of a tick')
        standing.send(tick + 1, machine.home + 2e-4)
        graph.spin_until(lambda count=count: len(joints) == 2 * count, 'a state at standstill')
    assert joints[2].velocity[0] == pytest.approx(1e-4 / 0.01)
    graph.spin_until(lambda: len(twists) == 3, 'twists of all states but the first')
    assert [twist.twist.linear.x for twist in twists][::2] == [0.0, 0.0], 'a machine that stands'


def test_delayed_state_at_standstill_is_dropped(graph, machine):
    """It was sent before the cycle that runs; a restarted machine begins with tick 0."""
    graph.start(StateEstimatorNode)
    joints = graph.listen(JointState, 'joint_states')
    encoders = [graph.publisher(EncoderSample, f'{joint}/encoder') for joint in machine.joints]
    standing = StandingMachine(graph, machine)
    for publisher, position in zip(encoders, machine.home, strict=True):
        publisher.publish(EncoderSample(tick=5 * STATES_EVERY, position=float(position)))
    graph.spin_until(lambda: joints, 'a state')
    standing.send(4 * STATES_EVERY, machine.home)
    graph.spin_in_silence()
    assert len(joints) == 1
    standing.send(0, machine.home)
    graph.spin_until(lambda: len(joints) == 2, 'the state of the restarted machine')


@pytest.mark.parametrize(
    ('names', 'positions'),
    [(['d1', 'd3'], [0.08, 0.14]), (['d3', 'd1', 'd5', 'd7'], 4 * [0.1]), (None, [0.1]), (None, [])],
)
def test_standstill_of_another_machine_is_refused(graph, machine, names, positions):
    graph.start(StateEstimatorNode)
    joints = graph.listen(JointState, 'joint_states')
    standing = StandingMachine(graph, machine)
    standing.send(0, positions, names)
    graph.spin_in_silence()
    assert not joints
    standing.send(0, machine.home)
    graph.spin_until(lambda: joints, 'the next state')


@pytest.mark.parametrize('bad', [math.nan, math.inf, 1.0])
def test_standstill_without_a_pose_has_the_motors_only(graph, machine, bad):
    graph.start(StateEstimatorNode)
    joints, poses = graph.listen(JointState, 'joint_states'), graph.listen(PoseStamped, 'pose', reliable(10))
    StandingMachine(graph, machine).send(0, [bad, *machine.home[1:]])
    graph.spin_until(lambda: joints, 'joint states')
    assert tuple(joints[0].name) == machine.joints
    assert not poses
