"""
Node `state_estimator`: encoders in, the state of the machine as standard messages out, by forward kinematics.

pose and joint_states are always published, because the recorder expects them. pose_with_covariance, twist, markers and
transforms are published only while they have a subscriber. Between cycles the state is that of machine/standing.
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
from pkm_interfaces.msg import EncoderSample, Standing
from pkm_nodes.graph import frame_prefix_of
from pkm_nodes.messages.conversions import nanoseconds_of_standstill, nanoseconds_of_tick, time_of_tick
from pkm_nodes.messages.diagnostics import COVARIANCE, GEOMETRY, STATE, STATE_RATE, diagnostics
from pkm_nodes.messages.markers import LinkMarkers
from pkm_nodes.messages.template import DOUBLE, POSE, STAMP, Template
from pkm_nodes.messages.tick_messages import ENCODER_SAMPLE
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.parts.rate import Rate
from pkm_nodes.parts.robot_description import RobotDescription
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import LAST_VALUE_QOS, STATE_QOS, TICK_QOS, PkmNode, entry_point

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
        self._tick, self._rate = -1, Rate()  # of the last state
        self._gathered = {}  # position by joint, by tick: samples of one joint may lag
        self._prefix = frame_prefix_of(self.get_namespace())
        self._description = RobotDescription(self, self._prefix)
        self._take_geometry()
        self._pose_publisher = self.create_publisher(PoseStamped, 'pose', STATE_QOS)
        self._spread_publisher = self.create_publisher(PoseWithCovarianceStamped, 'pose_with_covariance', STATE_QOS)
        self._twist_publisher = self.create_publisher(TwistStamped, 'twist', STATE_QOS)
        self._joints_publisher = self.create_publisher(JointState, 'joint_states', STATE_QOS)
        header = Header(stamp=STAMP, frame_id=self._prefix + ROOT)
        self._pose = Template(PoseStamped(header=header, pose=POSE))
        with_spread = PoseWithCovariance(pose=POSE, covariance=np.full(36, DOUBLE))
        self._pose_with_spread = Template(PoseWithCovarianceStamped(header=header, pose=with_spread))
        speed = Vector3(x=DOUBLE, y=DOUBLE, z=DOUBLE)
        self._twist = Template(TwistStamped(header=header, twist=Twist(linear=speed, angular=Vector3(z=DOUBLE))))
        self._joint_states = {}  # templates by the names of joints and the number of velocities
        self._markers_publisher = self.create_publisher(MarkerArray, 'markers', STATE_QOS)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', LAST_VALUE_QOS)
        self.create_timer(1.0, self._publish_diagnostics, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for i, joint in enumerate(self._machine.joints):
            self.on_tick_topic(EncoderSample, f'{joint}/encoder', partial(self._on_sample, i), size=ENCODER_SAMPLE.size)
        self._log_refusal = LogThrottle(self.get_logger(), is_error=True)
        subscribe_one(self, Standing, 'machine/standing', self._on_standing, LAST_VALUE_QOS)

    def _take_geometry(self):
        self._machine = self._geometry.machine
        self._previous = None  # tick, joints and pose of the last published state
        self._markers = LinkMarkers(self._machine, self._prefix)
        self._description.take(self._machine)
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

    def _on_standing(self, message):
        """Publish the state of a machine that stands; it stays out of the mean speeds of the next cycle."""
        machine = self._machine
        if tuple(message.joints) != machine.joints or len(message.position) != len(machine.joints):
            names, count = list(message.joints), len(message.position)
            self._log_refusal(
                f'machine/standing: {count} positions of {names} given; expected one of each of {machine.joints}'
            )
            return
        if 1 < message.tick <= self._tick:  # it was delayed, and a cycle runs; a restarted machine counts from 0
            return
        time = nanoseconds_of_standstill(message.tick, machine.sample_time)
        positions = np.array(message.position)
        pose, joints = self._state(positions, f'{time * 1e-9:.4f} s')
        self._publish_joints(time, joints, len(joints) * [0.0])
        if not pose:
            return
        self._publish_pose(time, pose, positions)
        self._description.rest(time, joints)
        if self._markers_publisher.get_subscription_count():
            self._markers_publisher.publish(self._markers.message(time, joints))
        if self._twist_publisher.get_subscription_count():
            self._publish_twist(time, dict.fromkeys(pose, 0.0))

    def _state(self, positions, when):
        """Return {coordinate: value} of the pose, empty if there is none, and {joint: position}."""
        machine = self._machine
        try:
            pose = dict(zip(machine.coordinates, machine.forward(positions).tolist(), strict=True))
            return pose, joint_positions(machine, positions)
        except PkmError as error:  # after a collision, or a reading that is not finite
            self._log_refusal(f'{when}: no pose: {error}', 'pose')
            return {}, dict(zip(machine.joints, positions.tolist(), strict=True))

    def _publish(self, positions):
        machine = self._machine
        time = nanoseconds_of_tick(self._tick, machine.sample_time)
        pose, joints = self._state(positions, f'tick {self._tick}')
        before, self._previous = self._previous, (self._tick, joints, pose)
        if pose:
            self._publish_pose(time, pose, positions)
            self._description.move(self._tick, time, joints)
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
        states = self._rate.of(self._tick // STATES_EVERY)
        values = {STATE: state, COVARIANCE: origin, GEOMETRY: geometry.digest, STATE_RATE: states}
        text = f'{state}; covariance of the pose from {origin}'
        stamp = time_of_tick(max(0, self._tick), self._machine.sample_time)
        self._diagnostics.publish(diagnostics(self, DiagnosticStatus.OK, text, values, stamp))


def _rates(now, before, elapsed):
    """Return the mean rates of the entries of `now`; none if the names differ from those of `before`."""
    if now.keys() != before.keys():
        return []
    return [(value - before[name]) / elapsed for name, value in now.items()]


main = entry_point(StateEstimatorNode)
