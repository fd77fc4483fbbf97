"""Node state_estimator: encoders in, pose and joint states of every POSE_EVERY-th tick out."""

import math
from math import cos, sin

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_interfaces.msg import EncoderSample
from pkm_nodes.state_estimator import POSE_EVERY, StateEstimatorNode


class Encoders:
    """The test in the place of the motors."""

    def __init__(self, graph, machine):
        self._publishers = [graph.publisher(EncoderSample, f'{joint}/encoder') for joint in machine.joints]

    def send(self, tick, positions):
        for publisher, position in zip(self._publishers, positions, strict=True):
            publisher.publish(EncoderSample(tick=tick, position=float(position)))


@pytest.fixture
def poses(graph):
    return graph.listen(PoseStamped, 'pose')


@pytest.fixture
def joint_states(graph):
    return graph.listen(JointState, 'joint_states')


@pytest.fixture
def encoders(graph, machine):
    graph.start(StateEstimatorNode)
    return Encoders(graph, machine)


def nanoseconds(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_pose_is_the_forward_kinematics_of_every_twentieth_tick(graph, encoders, poses, machine):
    ticks = range(2 * POSE_EVERY + 1)
    positions = {tick: machine.home + tick * np.array([1e-5, 2e-5, -1e-5, 3e-5]) for tick in ticks}
    for tick in ticks:
        encoders.send(tick, positions[tick])
    graph.spin_until(lambda: len(poses) == 3, 'three poses')
    for number, message in enumerate(poses):
        tick = number * POSE_EVERY
        x, y, z, phi = machine.forward(positions[tick])
        pose = message.pose
        assert nanoseconds(message) == tick * round(machine.sample_time * 1e9)
        assert message.header.frame_id == 'base'
        assert (pose.position.x, pose.position.y, pose.position.z) == (x, y, z)
        assert (pose.orientation.x, pose.orientation.y) == (0.0, 0.0)
        assert (pose.orientation.z, pose.orientation.w) == (sin(phi / 2), cos(phi / 2))


def test_joint_states_hold_positions_and_mean_speeds(graph, encoders, joint_states, machine):
    speed = np.array([0.1, -0.2, 0.3, 0.0])
    for tick in (0, POSE_EVERY, 2 * POSE_EVERY):
        encoders.send(tick, machine.home + speed * tick * machine.sample_time)
    graph.spin_until(lambda: len(joint_states) == 3, 'three joint states')
    first, _, last = joint_states
    assert tuple(last.name) == machine.joints
    assert np.array_equal(first.position, machine.home)
    assert len(first.velocity) == 0, 'one position has no speed'
    assert last.velocity == pytest.approx(speed)
    assert nanoseconds(last) == 20_000_000


def test_nothing_is_published_until_all_joints_of_a_tick_are_there(graph, machine, poses):
    graph.start(StateEstimatorNode)
    publishers = {joint: graph.publisher(EncoderSample, f'{joint}/encoder') for joint in machine.joints}
    positions = dict(zip(machine.joints, machine.home.tolist(), strict=True))
    for joint in ('d1', 'd3', 'd5'):
        publishers[joint].publish(EncoderSample(tick=0, position=positions[joint]))
    graph.spin_in_silence()
    assert not poses
    publishers['d7'].publish(EncoderSample(tick=0, position=positions['d7']))
    graph.spin_until(lambda: poses, 'a pose')


@pytest.mark.parametrize('bad', [math.nan, math.inf, 1.0])
def test_joint_positions_without_a_pose_give_none_and_the_next_ones_do(graph, encoders, poses, machine, bad):
    encoders.send(0, [bad, *machine.home[1:]])
    encoders.send(POSE_EVERY, machine.home)
    graph.spin_until(lambda: poses, 'a pose')
    assert [nanoseconds(pose) for pose in poses] == [10_000_000]


def test_planar_machine_has_x_and_y_and_stands_upright(graph, poses):
    planar = load_machine('planar')
    graph.start(StateEstimatorNode, machine='planar')
    Encoders(graph, planar).send(0, planar.home)
    graph.spin_until(lambda: poses, 'a pose')
    x, y = planar.forward(planar.home)
    position, orientation = poses[0].pose.position, poses[0].pose.orientation
    assert (position.x, position.y, position.z) == (x, y, 0.0)
    assert (orientation.z, orientation.w) == (0.0, 1.0)


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown"),
        ({'pose_every': 20}, r"/pkm/state_estimator has unknown parameter\(s\) \['pose_every'\]; known: .*'machine'"),
    ],
)
def test_parameter_that_cannot_be_is_refused_by_name(graph, parameters, text):
    with pytest.raises(ConfigError, match=text):
        graph.start(StateEstimatorNode, **parameters)
