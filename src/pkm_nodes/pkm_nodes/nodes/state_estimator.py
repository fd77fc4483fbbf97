"""
Node `state_estimator`: encoders in, the state of the machine as standard messages out, by forward kinematics.

pose and joint_states are always published, because the recorder expects them. pose_with_covariance, twist and markers
are published only while they have a subscriber.
"""

from functools import partial
from math import cos, sin

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Twist,
    TwistStamped,
    Vector3,
)
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from pkm_core.design.pose_covariance import PoseCovariance
from pkm_core.errors import PkmError
from pkm_core.machines.description import ROOT, joint_positions
from pkm_core.machines.geometry import load_geometry
from pkm_core.recording.topics import STATES_EVERY
from pkm_interfaces.msg import EncoderSample
from pkm_nodes.messages.conversions import nanoseconds_of_tick, time_of_tick
from pkm_nodes.messages.diagnostics import COVARIANCE, GEOMETRY, STATE, diagnostics
from pkm_nodes.messages.markers import LinkMarkers
from pkm_nodes.messages.template import DOUBLE, POSE, STAMP, Template
from pkm_nodes.messages.tick_messages import ENCODER_SAMPLE
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.runtime.node import CYCLE_QOS, TICK_QOS, PkmNode, entry_point

# [ticks] period of the markers, 20 Hz of simulated time: they cost most and are for display only
MARKERS_EVERY = 100
# rows of the covariance of a message, x y z and the rotations about them, that have a coordinate
_ROWS = {'x': 0, 'y': 1, 'z': 2, 'phi': 5}
# most states that wait for a joint whose samples lag: a joint further behind has lost samples
_MOST_GATHERED = TICK_QOS.depth // STATES_EVERY


class StateEstimatorNode(PkmNode):
    """Publishes pose, twist and joint_states of every `STATES_EVERY`-th tick, markers less often."""

    def __init__(self, **kwargs):
        super().__init__('state_estimator', **kwargs)
        geometry = load_geometry(self.machine_setting())
        self.check_settings()
        self._geometry = NodeGeometry(self, geometry, self._take_geometry)
        self._tick = -1  # of the last state
        self._gathered = {}  # position by joint, by tick: samples of one joint may lag
        self._take_geometry()
        self._pose_publisher = self.create_publisher(PoseStamped, 'pose', CYCLE_QOS)
        self._spread_publisher = self.create_publisher(PoseWithCovarianceStamped, 'pose_with_covariance', CYCLE_QOS)
        self._twist_publisher = self.create_publisher(TwistStamped, 'twist', CYCLE_QOS)
        self._joints_publisher = self.create_publisher(JointState, 'joint_states', CYCLE_QOS)
        header = Header(stamp=STAMP, frame_id=ROOT)
        self._pose = Template(PoseStamped(header=header, pose=POSE))
        with_spread = PoseWithCovariance(pose=POSE, covariance=np.full(36, DOUBLE))
        self._pose_with_spread = Template(PoseWithCovarianceStamped(header=header, pose=with_spread))
        speed = Vector3(x=DOUBLE, y=DOUBLE, z=DOUBLE)
        self._twist = Template(TwistStamped(header=header, twist=Twist(linear=speed, angular=Vector3(z=DOUBLE))))
        self._joint_states = {}  # templates by the names of joints and the number of velocities
        self._markers_publisher = self.create_publisher(MarkerArray, 'markers', CYCLE_QOS)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(1.0, self._publish_diagnostics, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for i, joint in enumerate(self._machine.joints):
            self.on_tick_topic(EncoderSample, f'{joint}/encoder', partial(self._on_sample, i), size=ENCODER_SAMPLE.size)

    def _take_geometry(self):
        self._machine = self._geometry.machine
        self._previous = None  # tick, joints and pose of the last published state
        self._markers = LinkMarkers(self._machine)
        self._spread = PoseCovariance(self._machine)
        rows = [_ROWS[name] for name in self._machine.coordinates]
        self._places = np.ix_(rows, rows)  # of the coordinates in the covariance of a message

    def _on_sample(self, joint, data):
        tick, _, _, _, _, position = ENCODER_SAMPLE.unpack(data)
        if tick % STATES_EVERY:
            return
        positions = self._gathered.setdefault(tick, {})
        positions[joint] = position
        if len(positions) < len(self._machine.joints):
            if len(self._gathered) > _MOST_GATHERED:
                del self._gathered[next(iter(self._gathered))]
            return
        restarted = tick <= self._tick  # a restarted machine counts from 0
        self._gathered = {} if restarted else {later: part for later, part in self._gathered.items() if later > tick}
        self._tick = tick
        self._publish(np.array([positions[i] for i in range(len(positions))]))

    def _publish(self, positions):
        machine = self._machine
        time = nanoseconds_of_tick(self._tick, machine.sample_time)
        try:
            pose = dict(zip(machine.coordinates, machine.forward(positions).tolist(), strict=True))
            joints = joint_positions(machine, positions)
        except PkmError as error:  # after a collision, or a reading that is not finite
            self.get_logger().error(f'tick {self._tick}: no pose: {error}')
            pose, joints = {}, dict(zip(machine.joints, positions.tolist(), strict=True))
        before, self._previous = self._previous, (self._tick, joints, pose)
        if pose:
            self._publish_pose(time, pose, positions)
        if pose and self._tick % MARKERS_EVERY == 0 and self._markers_publisher.get_subscription_count():
            self._markers_publisher.publish(self._markers.message(time, joints))
        # mean speed since the last state: one count of 0.2 um in 10 ms is 20 um/s, so no filter is needed
        elapsed = 0.0 if before is None else (self._tick - before[0]) * machine.sample_time
        self._publish_joints(time, joints, _rates(joints, before[1], elapsed) if elapsed > 0 else [])
        if elapsed > 0 and pose and before[2] and self._twist_publisher.get_subscription_count():
            self._publish_twist(time, dict(zip(pose, _rates(pose, before[2], elapsed), strict=True)))

    def _publish_pose(self, time, pose, positions):
        half = pose.get('phi', 0.0) / 2
        numbers = [pose['x'], pose['y'], pose.get('z', 0.0), 0.0, 0.0, sin(half), cos(half)]
        self._pose_publisher.publish(self._pose.filled(numbers, time))
        if self._spread_publisher.get_subscription_count():
            covariance = np.zeros((6, 6))
            covariance[self._places] = self._spread.at(positions)
            self._spread_publisher.publish(self._pose_with_spread.filled([*numbers, *covariance.ravel()], time))

    def _publish_twist(self, time, rates):
        numbers = [rates['x'], rates['y'], rates.get('z', 0.0), rates.get('phi', 0.0)]
        self._twist_publisher.publish(self._twist.filled(numbers, time))

    def _publish_joints(self, time, positions, velocities):
        """Publish motors first, then passive joints, which are missing where forward kinematics has no solution."""
        key = (*positions, len(velocities))
        if key not in self._joint_states:
            gaps = {'position': len(positions) * [DOUBLE], 'velocity': len(velocities) * [DOUBLE]}
            self._joint_states[key] = Template(JointState(header=Header(stamp=STAMP), name=list(positions), **gaps))
        self._joints_publisher.publish(self._joint_states[key].filled([*positions.values(), *velocities], time))

    def _publish_diagnostics(self):
        geometry, origin = self._geometry.geometry, self._spread.origin
        state = 'calibrated' if geometry.is_calibrated else 'uncalibrated'
        values = {STATE: state, COVARIANCE: origin, GEOMETRY: geometry.digest}
        text = f'{state}; covariance of the pose from {origin}'
        stamp = time_of_tick(max(0, self._tick), self._machine.sample_time)
        self._diagnostics.publish(diagnostics(self, DiagnosticStatus.OK, text, values, stamp))


def _rates(now, before, elapsed):
    """Return the mean rates of the entries of `now`; none if the names differ from those of `before`."""
    if now.keys() != before.keys():
        return []
    return [(value - before[name]) / elapsed for name, value in now.items()]


main = entry_point(StateEstimatorNode)
