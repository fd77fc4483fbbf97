"""Node state_estimator: encoders in, the state of every STATES_EVERY-th tick out, in standard messages."""

import math
from math import cos, sin

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from pkm_core.design.calibration import built_machine
from pkm_core.design.pose_covariance import PoseCovariance
from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_core.machines.description import ROOT, base_boxes, frames, joint_positions, links, moved
from pkm_core.machines.geometry import load_geometry
from pkm_core.machines.identity import Specimen
from pkm_core.recording.topics import STATES_EVERY
from pkm_interfaces.msg import EncoderSample
from pkm_interfaces.srv import SetGeometry
from pkm_nodes.messages.diagnostics import values_of
from pkm_nodes.nodes.state_estimator import StateEstimatorNode


class Encoders:
    """Replacement of the motors."""

    def __init__(self, graph, machine):
        self._publishers = [graph.publisher(EncoderSample, f'{joint}/encoder') for joint in machine.joints]

    def send(self, tick, positions):
        for joint, position in enumerate(positions):
            self.send_one(joint, tick, position)

    def send_one(self, joint, tick, position):
        self._publishers[joint].publish(EncoderSample(tick=tick, position=float(position)))


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
    ticks = range(2 * STATES_EVERY + 1)
    positions = {tick: machine.home + tick * np.array([1e-5, 2e-5, -1e-5, 3e-5]) for tick in ticks}
    for tick in ticks:
        encoders.send(tick, positions[tick])
    graph.spin_until(lambda: len(poses) == 3, 'three poses')
    for number, message in enumerate(poses):
        tick = number * STATES_EVERY
        x, y, z, phi = machine.forward(positions[tick])
        pose = message.pose
        assert nanoseconds(message) == tick * round(machine.sample_time * 1e9)
        assert message.header.frame_id == 'base_link'
        assert (pose.position.x, pose.position.y, pose.position.z) == (x, y, z)
        assert (pose.orientation.x, pose.orientation.y) == (0.0, 0.0)
        assert (pose.orientation.z, pose.orientation.w) == (sin(phi / 2), cos(phi / 2))


def test_joint_that_lags_by_a_whole_state_loses_none(graph, encoders, poses, machine):
    states = {number * STATES_EVERY: machine.home + number * 1e-4 for number in range(4)}
    for first, last in ((0, 3), (3, 4)):
        for tick, positions in states.items():
            for joint in range(first, last):
                encoders.send_one(joint, tick, positions[joint])
        graph.spin_in_silence()
        assert len(poses) == (0 if last == 3 else len(states))
    for message, positions in zip(poses, states.values(), strict=True):
        assert message.pose.position.x == machine.forward(positions)[0]


def test_samples_of_a_restarted_machine_are_kept_apart(graph, encoders, poses, machine):
    for tick in (0, STATES_EVERY):
        encoders.send(tick, machine.home)
    encoders.send_one(0, 2 * STATES_EVERY, machine.home[0] + 1e-3)
    graph.spin_until(lambda: len(poses) == 2, 'two poses')
    for tick in (0, STATES_EVERY):
        encoders.send(tick, machine.home)
    graph.spin_until(lambda: len(poses) == 4, 'two more')
    for joint in (1, 2, 3):
        encoders.send_one(joint, 2 * STATES_EVERY, machine.home[joint])
    graph.spin_in_silence()
    assert len(poses) == 4, 'the sample of the first joint is missing'


def test_joint_states_have_all_joints_with_mean_speeds(graph, encoders, joint_states, machine):
    speed = np.array([0.1, -0.2, 0.3, 0.0])
    ticks = (0, STATES_EVERY, 2 * STATES_EVERY)
    positions = [machine.home + speed * tick * machine.sample_time for tick in ticks]
    for tick, position in zip(ticks, positions, strict=True):
        encoders.send(tick, position)
    graph.spin_until(lambda: len(joint_states) == 3, 'three joint states')
    first, second, last = joint_states
    assert tuple(last.name) == (*machine.joints, *machine.passive_angles(machine.home))
    for message, position in zip(joint_states, positions, strict=True):
        assert dict(zip(message.name, message.position, strict=True)) == joint_positions(machine, position)
    assert len(first.velocity) == 0, 'one position has no speed'
    assert last.velocity[: len(speed)] == pytest.approx(speed)
    assert last.velocity == pytest.approx((np.array(last.position) - second.position) / 0.01)
    assert nanoseconds(last) == 20_000_000


def test_twist_is_the_mean_speed_of_the_platform(graph, encoders, machine):
    twists = graph.listen(TwistStamped, 'twist')
    start, end = machine.home, machine.home + np.array([5e-4, 3e-4, -2e-4, 4e-4])
    encoders.send(0, start)
    encoders.send(STATES_EVERY, end)
    graph.spin_until(lambda: twists, 'a twist')
    twist = twists[0].twist
    speeds = (machine.forward(end) - machine.forward(start)) / 0.01
    assert (twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.z) == pytest.approx(tuple(speeds))
    assert (twist.angular.x, twist.angular.y) == (0.0, 0.0)
    assert twists[0].header.frame_id == 'base_link'
    # the mean of J(q) qd over the step, whose ends differ by the curvature over 0.5 mm
    middle = machine.jacobian((start + end) / 2) @ ((end - start) / 0.01)
    assert speeds == pytest.approx(middle, rel=1e-3)


def test_pose_with_covariance_repeats_the_pose(graph, encoders, poses, machine):
    """Its covariance is that of x, y, z and the rotation about z; the other rotations have none."""
    spreads = graph.listen(PoseWithCovarianceStamped, 'pose_with_covariance')
    q = machine.home + np.array([5e-3, 3e-3, -2e-3, 4e-3])
    encoders.send(0, q)
    graph.spin_until(lambda: spreads and poses, 'a pose with covariance')
    assert spreads[0].pose.pose == poses[0].pose
    assert spreads[0].header == poses[0].header
    covariance = spreads[0].pose.covariance.reshape(6, 6)
    rows = np.ix_([0, 1, 2, 5], [0, 1, 2, 5])
    expected = PoseCovariance(machine).at(q)
    assert np.array_equal(covariance[rows], expected)
    assert np.count_nonzero(covariance) == np.count_nonzero(expected)
    assert 1e-7 < np.sqrt(covariance[0, 0]) < 1e-4, 'micrometres, by the tolerances'


def test_diagnostics_say_that_the_machine_is_uncalibrated(graph):
    received = graph.listen(DiagnosticArray, '/diagnostics')
    graph.start(StateEstimatorNode, machine='planar')
    graph.spin_until(lambda: received, 'diagnostics')
    values = values_of(received[0].status[0])
    assert values['state'] == 'uncalibrated'
    assert values['covariance'] == 'manufacturing tolerances'


def test_another_geometry_is_taken_up(graph, poses):
    """The pose is that of the calibrated lengths, and the diagnostics have their hash."""
    drawn = load_geometry('planar')
    built = built_machine(drawn.machine, {'l2': 40e-6}, Specimen.measured('planar')).config.built
    lengths = ', '.join(f'{name}: {value} m' for name, value in built.lengths().items())
    section = (
        f'built: {{specimen: {{machine: planar, origin: measured machine}}, {lengths}, marks: {{d1: 0 m, d3: 0 m}}}}'
    )
    calibrated = drawn.exchanged('new.yaml', f'{drawn.text}\n{section}\n')
    received = graph.listen(DiagnosticArray, '/diagnostics')
    graph.start(StateEstimatorNode, machine='planar')
    request = SetGeometry.Request(file='new.yaml', text=calibrated.text)
    answer = graph.call(SetGeometry, 'state_estimator/geometry', request)
    assert (answer.success, answer.geometry) == (True, calibrated.digest), answer.message
    received.clear()
    q = drawn.machine.home + 1e-3
    Encoders(graph, drawn.machine).send(0, q)
    graph.spin_until(lambda: poses and received, 'a pose and diagnostics')
    position = poses[0].pose.position
    assert [position.x, position.y] == calibrated.machine.forward(q).tolist() != drawn.machine.forward(q).tolist()
    values = values_of(received[0].status[0])
    assert (values['state'], values['geometry']) == ('calibrated', calibrated.digest)
    assert values['covariance'] == 'manufacturing tolerances', 'the file states no uncertainty'


def test_markers_show_every_box_at_its_position(graph, encoders, machine):
    arrays = graph.listen(MarkerArray, 'markers')
    q = machine.home + np.array([1e-3, 2e-3, -3e-3, 4e-3])
    encoders.send(0, q)
    graph.spin_until(lambda: arrays, 'markers')
    markers = {(marker.ns, marker.id): marker for marker in arrays[0].markers}
    described = links(machine)
    boxes = {(link.name, i): box for link in described for i, box in enumerate(link.boxes)}
    boxes |= {(ROOT, i): box for i, box in enumerate(base_boxes(machine))}
    assert markers.keys() == boxes.keys()
    found = frames(described, joint_positions(machine, q))
    for (name, number), box in boxes.items():
        marker = markers[name, number]
        turn, origin = found[name]
        assert marker.type == Marker.CUBE
        assert marker.header.frame_id == 'base_link'
        assert (marker.scale.x, marker.scale.y, marker.scale.z) == box.size
        place, stands = marker.pose.position, marker.pose.orientation
        assert (place.x, place.y, place.z) == moved(turn, origin, box.centre)
        assert (stands.w, stands.x, stands.y, stands.z) == turn


def test_covariance_twist_and_markers_need_a_subscriber(graph, poses, machine, monkeypatch):
    estimator = graph.start(StateEstimatorNode)
    encoders = Encoders(graph, machine)
    for publisher in ('_spread_publisher', '_twist_publisher', '_markers_publisher'):
        monkeypatch.setattr(getattr(estimator, publisher), 'publish', pytest.fail)
    encoders.send(0, machine.home)
    encoders.send(STATES_EVERY, machine.home)
    graph.spin_until(lambda: len(poses) == 2, 'two poses')


def test_nothing_is_published_before_all_joints_of_a_tick(graph, machine, poses):
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
def test_positions_without_a_pose_publish_motors_only(graph, encoders, poses, joint_states, machine, bad):
    encoders.send(0, [bad, *machine.home[1:]])
    encoders.send(STATES_EVERY, machine.home)
    graph.spin_until(lambda: poses and len(joint_states) == 2, 'a pose and two joint states')
    assert [nanoseconds(pose) for pose in poses] == [10_000_000]
    assert tuple(joint_states[0].name) == machine.joints
    assert len(joint_states[1].velocity) == 0, 'the passive joints have no speed yet'


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
def test_invalid_parameter_is_refused_by_name(graph, parameters, text):
    with pytest.raises(ConfigError, match=text):
        graph.start(StateEstimatorNode, **parameters)
