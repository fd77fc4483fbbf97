"""Node `state_estimator`: encoders in, end-effector pose and joint states out, by forward kinematics."""

import sys
from math import cos, sin

import numpy as np
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_interfaces.msg import EncoderSample
from pkm_nodes.conversions import time_of_tick
from pkm_nodes.node import CYCLE_QOS, PkmNode, run

# [ticks] poses go out at 100 Hz of simulated time
POSE_EVERY = 20


class StateEstimatorNode(PkmNode):
    """Publishes pose and joint_states of every `POSE_EVERY`-th tick."""

    def __init__(self, **kwargs):
        super().__init__('state_estimator', **kwargs)
        self._machine = load_machine(self.setting('machine', 'four_dof', 'machine of config/machines, or a YAML file'))
        self.check_settings()
        joints = self._machine.joints
        self._positions = np.zeros(len(joints))
        self._previous = None  # tick and positions of the last published state
        self._tick, self._arrived = -1, 0
        self._pose_publisher = self.create_publisher(PoseStamped, 'pose', CYCLE_QOS)
        self._joints_publisher = self.create_publisher(JointState, 'joint_states', CYCLE_QOS)
        for i, joint in enumerate(joints):
            self.on_tick_topic(EncoderSample, f'{joint}/encoder', lambda sample, i=i: self._on_sample(i, sample))

    def _on_sample(self, joint, sample):
        if sample.tick % POSE_EVERY:
            return
        if sample.tick != self._tick:
            self._tick, self._arrived = sample.tick, 0
        self._positions[joint] = sample.position
        self._arrived += 1
        if self._arrived == len(self._positions):
            self._publish()

    def _publish(self):
        stamp = time_of_tick(self._tick, self._machine.sample_time)
        try:
            pose = self._machine.forward(self._positions).tolist()
        except PkmError as error:  # after a collision, or a reading that is not finite
            self.get_logger().error(f'tick {self._tick}: no pose: {error}')
        else:
            self._publish_pose(stamp, dict(zip(self._machine.coordinates, pose, strict=True)))
        self._publish_joints(stamp)

    def _publish_pose(self, stamp, coordinates):
        pose = PoseStamped()
        pose.header.stamp = stamp
        pose.header.frame_id = 'base'
        pose.pose.position.x = coordinates['x']
        pose.pose.position.y = coordinates['y']
        pose.pose.position.z = coordinates.get('z', 0.0)
        half = coordinates.get('phi', 0.0) / 2
        pose.pose.orientation.z, pose.pose.orientation.w = sin(half), cos(half)
        self._pose_publisher.publish(pose)

    def _publish_joints(self, stamp):
        joints = JointState(name=list(self._machine.joints), position=self._positions.tolist())
        joints.header.stamp = stamp
        if self._previous is not None and self._tick > self._previous[0]:
            # the mean speed since the last state: 0.2 um counts over 10 ms are 20 um/s, so no filter is needed
            elapsed = (self._tick - self._previous[0]) * self._machine.sample_time
            joints.velocity = ((self._positions - self._previous[1]) / elapsed).tolist()
        self._previous = (self._tick, self._positions.copy())
        self._joints_publisher.publish(joints)


def make_nodes():
    """Return this process's node."""
    return [StateEstimatorNode()]


def main(args=None):
    """Run the node as a process of its own."""
    sys.exit(run(make_nodes, args))
