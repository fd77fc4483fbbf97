"""robot_description and transforms of the state_estimator: the tree is closed and ends at the pose."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from pkm_core.machines import load_machine
from pkm_core.machines.description import ROOT, TOOL
from pkm_core.machines.urdf import urdf
from pkm_interfaces.msg import EncoderSample, Standing
from pkm_nodes.graph import frame_prefix_of
from pkm_nodes.messages.transforms import find_tf_message
from pkm_nodes.nodes.state_estimator import StateEstimatorNode
from pkm_nodes.runtime.node import LAST_VALUE_QOS
from support.urdf_tree import UrdfTree

LATCHED = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
single = pytest.mark.skipif(find_tf_message() is not None, reason='transforms are on /tf where tf2_msgs is installed')


def place_of(frame, transforms):
    """Return rotation and origin [m] of `frame` in the root, by the messages {child frame: transform}."""
    R, p = np.eye(3), np.zeros(3)
    while frame in transforms:
        message = transforms[frame]
        place, turn = message.transform.translation, message.transform.rotation
        x, y, z, w = turn.x, turn.y, turn.z, turn.w
        R_parent = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        R, p = R_parent @ R, np.array([place.x, place.y, place.z]) + R_parent @ p
        frame = message.header.frame_id
    return R, p, frame


@pytest.mark.parametrize('name', ['four_dof', 'planar', 'xy_stage'])
def test_late_subscriber_gets_the_description(graph, name):
    graph.start(StateEstimatorNode, machine=name)
    heard = graph.listen(String, 'robot_description', LAST_VALUE_QOS)
    graph.spin_until(lambda: heard, 'the description')
    assert heard[0].data == urdf(load_machine(name))


@single
@pytest.mark.parametrize('name', ['four_dof', 'planar', 'xy_stage'])
def test_description_and_transforms_close_the_loops(graph, name):
    """By two ways, to 1 nm: the URDF at the published joint_states, and the published transforms."""
    machine = load_machine(name)
    described = graph.listen(String, 'robot_description', LAST_VALUE_QOS)
    fixed = graph.listen(TransformStamped, 'transforms_static', LATCHED)
    moving = graph.listen(TransformStamped, 'transforms')
    joints, poses = graph.listen(JointState, 'joint_states'), graph.listen(PoseStamped, 'pose')
    graph.start(StateEstimatorNode, machine=name)
    q = machine.home + np.array([3e-3, 4e-3, -5e-3, 2e-3])[: len(machine.joints)]
    for joint, position in zip(machine.joints, q, strict=True):
        graph.publisher(EncoderSample, f'{joint}/encoder').publish(EncoderSample(tick=0, position=float(position)))
    graph.spin_until(lambda: described and poses and joints, 'a state')
    tree = UrdfTree(described[0].data)
    graph.spin_until(lambda: len(moving) + len(fixed) >= len(tree.joints), 'the transforms of all links')

    transforms = {message.child_frame_id: message for message in (*moving, *fixed)}
    assert transforms.keys() == tree.joints.keys()
    found = tree.place(dict(zip(joints[0].name, joints[0].position, strict=True)))
    for link, moved in found.items():
        R, p, root = place_of(link, transforms)
        assert root == ROOT
        np.testing.assert_allclose(R, moved.R, atol=1e-9)
        np.testing.assert_allclose(p, moved.p, atol=1e-9)
    place = poses[0].pose.position
    np.testing.assert_allclose(found[TOOL].p, [place.x, place.y, place.z], atol=1e-9)
    ends = {'four_dof': ('link_4', 'link_6', 'link_12'), 'planar': ('link_4',), 'xy_stage': ()}[name]
    meets = {'link_4': 'platform_p', 'link_6': 'platform_q', 'link_12': 'end_effector'}
    for link in ends:  # the loops, cut at the end of these links
        length = machine.config.geometry.k10 if link == 'link_12' else machine.config.geometry.l2
        end = found[link].p + found[link].R @ np.array([length, 0.0, 0.0])
        np.testing.assert_allclose(end, found[meets[link]].p, atol=1e-9)


@single
def test_transforms_at_rest_are_not_repeated(graph):
    """A transform with the same time is not repeated: buffers of tf2 would keep every copy."""
    machine = load_machine('xy_stage')
    graph.start(StateEstimatorNode, machine='xy_stage')
    first, poses = graph.listen(TransformStamped, 'transforms'), graph.listen(PoseStamped, 'pose')
    publisher = graph.publisher(Standing, 'machine/standing', LAST_VALUE_QOS)

    def stand(tick):
        poses.clear()
        publisher.publish(Standing(tick=tick, joints=list(machine.joints), position=machine.home.tolist()))
        graph.spin_until(lambda: poses, 'a pose')

    stand(10)
    graph.spin_until(lambda: len(first) == 2, 'both axes')
    stand(10)
    graph.spin_in_silence()
    assert len(first) == 2
    second = graph.listen(TransformStamped, 'transforms')
    stand(10)
    graph.spin_until(lambda: len(second) == 2, 'both axes, for the new subscriber')
    before = len(first)
    stand(11)
    graph.spin_until(lambda: len(first) == before + 2, 'the next time')


@pytest.mark.parametrize(('namespace', 'prefix'), [('/pkm', ''), ('/left', 'left/'), ('/line/left', 'line/left/')])
def test_frames_of_another_namespace_have_its_prefix(namespace, prefix):
    assert frame_prefix_of(namespace) == prefix


@single
def test_all_frames_of_a_cell_have_its_prefix(graph, machine):
    """Two cells in one graph have no frame in common; the links of the URDF have no prefix."""
    graph.start(StateEstimatorNode, namespace='left')
    fixed = graph.listen(TransformStamped, '/left/transforms_static', LATCHED)
    moving = graph.listen(TransformStamped, '/left/transforms')
    poses = graph.listen(PoseStamped, '/left/pose')
    message = Standing(joints=list(machine.joints), position=machine.home.tolist())
    graph.publisher(Standing, '/left/machine/standing', LAST_VALUE_QOS).publish(message)
    graph.spin_until(lambda: fixed and len(moving) > 10 and poses, 'transforms and a pose')
    frames = {frame for each in (*fixed, *moving) for frame in (each.header.frame_id, each.child_frame_id)}
    frames |= {poses[0].header.frame_id}
    assert {f'left/{ROOT}', f'left/{TOOL}'} <= frames
    assert all(frame.startswith('left/') for frame in frames)
