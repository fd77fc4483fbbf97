"""Node inverse_kinematics: conversion of pose trajectories to joint trajectories, and refusals."""

import math
from array import array

import numpy as np
import pytest

from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_core.motion.trajectory import DERIVATIVES, to_joints
from pkm_interfaces.msg import CycleEvent, SampledTrajectory
from pkm_nodes.messages.conversions import trajectory_to_msg
from pkm_nodes.nodes.inverse_kinematics import InverseKinematicsNode


@pytest.fixture
def poses(graph):
    """Start the node and return a publisher of pose trajectories."""
    graph.start(InverseKinematicsNode)
    return graph.publisher(SampledTrajectory, 'pose_trajectory')


@pytest.fixture
def joints(graph):
    return graph.listen(SampledTrajectory, 'joint_trajectory')


@pytest.fixture
def pose_message(short_motion):
    return trajectory_to_msg(short_motion, cycle=4, motion='short', learning_law='fourier')


def test_joint_trajectory_is_the_inverse_of_the_poses(graph, poses, joints, pose_message, short_motion, machine):
    """Up to the jerk."""
    poses.publish(pose_message)
    graph.spin_until(lambda: joints, 'a joint trajectory')
    message, expected = joints[0], to_joints(machine, short_motion)
    assert tuple(message.coordinates) == machine.joints
    for name in DERIVATIVES:
        assert np.array_equal(np.array(getattr(message, name)).reshape(-1, 4), getattr(expected, name))


def test_fields_other_than_coordinates_are_passed_on(graph, poses, joints, pose_message):
    poses.publish(pose_message)
    graph.spin_until(lambda: joints, 'a joint trajectory')
    for name in ('cycle', 'motion', 'learning_law', 'sample_time', 'move_starts', 'move_ends'):
        assert getattr(joints[0], name) == getattr(pose_message, name)


def test_piece_of_a_jog_stays_a_piece(graph, poses, joints, pose_message):
    pose_message.offset, pose_message.hold, pose_message.stay = 50, 70, True
    poses.publish(pose_message)
    graph.spin_until(lambda: joints, 'a joint trajectory')
    assert (joints[0].offset, joints[0].hold, joints[0].stay) == (50, 70, True)


def with_nan(message):
    message.position[4 * 3 + 1] = math.nan


def with_infinite_jerk(message):
    message.jerk[-1] = math.inf


def in_joints(message):
    message.coordinates = ['d1', 'd3', 'd5', 'd7']


def at_1_khz(message):
    message.sample_time = 1e-3


def with_a_column_missing(message):
    message.velocity = message.velocity[: 3 * len(message.velocity) // 4]


def without_samples(message):
    for name in DERIVATIVES:
        setattr(message, name, [])


def without_moves(message):
    message.move_starts, message.move_ends = [], []


def below_the_table(message):
    message.position[4 * 9 + 2] = -0.05


def beyond_the_travel(message):
    pose = load_machine('four_dof').forward([0.0590, 0.1395, 0.1395, 0.0795])  # d1 begins at 59.5 mm
    message.position[4 * 9 : 4 * 10] = array('d', pose)


def of_another_geometry(message):
    message.geometry = '0123456789ab'


def too_fast(message):
    for index in range(0, len(message.velocity), 4):
        message.velocity[index] *= 20.0


@pytest.mark.parametrize(
    ('spoil', 'text'),
    [
        (with_nan, 'position of y at sample 3 is nan; expected a finite number'),
        (with_infinite_jerk, 'jerk of phi at sample 39 is inf; expected a finite number'),
        (in_joints, "has coordinates ['d1', 'd3', 'd5', 'd7']; expected ['x', 'y', 'z', 'phi']"),
        (at_1_khz, 'has a sample time of 0.001 s; expected 0.0005 s'),
        (with_a_column_missing, 'velocity has shape (30, 4); expected (40, 4)'),
        (without_samples, '0 position values; expected'),
        (without_moves, 'moves from samples [] to []; expected at least one'),
        (below_the_table, '(z = -50 mm; allowed 10 to 126.6 mm'),
        (beyond_the_travel, '(d1 = 59 mm; allowed 59.5 to 99.5 mm'),
        (too_fast, 'allowed 0.8 m/s'),
        (of_another_geometry, "trajectory of cycle 4: geometry '0123456789ab'; inverse_kinematics has"),
    ],
)
def test_infeasible_trajectory_is_refused(graph, poses, joints, pose_message, spoil, text, short_motion):
    """The next valid one is converted."""
    spoil(pose_message)
    poses.publish(pose_message)
    refused = graph.next_event(CycleEvent.REFUSED)
    assert (refused.source, refused.cycle) == ('inverse_kinematics', 4)
    assert text in refused.message
    poses.publish(trajectory_to_msg(short_motion, cycle=5, motion='short', learning_law='none'))
    graph.spin_until(lambda: joints, 'a joint trajectory')
    assert [message.cycle for message in joints] == [5]


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown; .*'planar'"),
        ({'joint': 'd1'}, r"inverse_kinematics has unknown parameter\(s\) \['joint'\]; known: .*'machine'"),
    ],
)
def test_invalid_parameter_is_refused_by_name(graph, parameters, text):
    with pytest.raises(ConfigError, match=text):
        graph.start(InverseKinematicsNode, **parameters)


def test_refusal_with_several_publishers_names_them(graph, poses, pose_message):
    """Before the graph is known a foreign trajectory is read too; its refusal says who may have sent it."""
    events = graph.listen(CycleEvent, 'cycle_events')
    graph.publisher(SampledTrajectory, 'pose_trajectory')
    pose_message.coordinates = []
    graph.spin_until(lambda: graph.node.count_publishers('pose_trajectory') == 2, 'both publishers')
    poses.publish(pose_message)
    graph.spin_until(lambda: events, 'a refusal')
    assert '; /pkm/pose_trajectory has 2 publishers, /pkm/' in events[-1].message
    assert events[-1].message.endswith('; allowed: 1')
