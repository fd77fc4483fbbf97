"""Node trajectory_generator: streams on jog that run, stop and are refused. The wall time is that of the test."""

from math import nan

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from rclpy.action import ActionClient
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory

from pkm_core.motion.jog import PERIOD
from pkm_core.motion.trajectory import to_joints
from pkm_core.servo.jog_stream import END_AFTER, SILENCE
from pkm_interfaces.action import Home
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.conversions import trajectory_from_msg
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.runtime.node import CYCLE_QOS, PkmNode
from support.goals import MOTION


class Commander:
    """A commander that streams in a time of its own, and the machine that uses its pieces at once."""

    def __init__(self, graph, stand_in, publisher, monkeypatch):
        self._graph, self._stand_in, self._publisher = graph, stand_in, publisher
        self.now, self._used = 0.0, 0
        monkeypatch.setattr('pkm_nodes.parts.jog.monotonic', lambda: self.now)

    @property
    def pieces(self):
        """The messages that extend a cycle; that which begins it may come again, once per second of wall time."""
        return [each for each in self._stand_in.trajectories if each.offset]

    def send(self, frame='base_link', **velocities):
        """Send a message, after a little more than the time of one piece."""
        self.now += 1.001 * PERIOD
        message = TwistStamped()
        message.header.frame_id = frame
        for name, value in velocities.items():
            kind, axis = ('angular', name[1]) if len(name) == 2 else ('linear', name)
            setattr(getattr(message.twist, kind), axis, value)
        self._publisher.publish(message)

    def begin(self, cycle=1, **velocities):
        """Begin a jog and return its first piece, which the machine runs."""
        self.send(**velocities)
        return self._stand_in.start(cycle)

    def piece(self, **velocities):
        """Send a message and return the next piece, which the machine uses."""
        if velocities:
            self.send(**velocities)
        self._graph.spin_until(lambda: len(self.pieces) > self._used, 'a piece')
        return self.use()

    def rest(self, **message):
        """Return whether the platform comes to rest; one piece may have been due before, a stop takes two."""
        pieces = []
        for _ in range(4):
            if message:
                self.send(**message)
            else:
                self.now += 1.001 * PERIOD
            pieces.append(self.piece())
        return not velocity_at_hold(pieces[-1]).any()

    def use(self):
        """Let the machine use the next piece, and return it."""
        piece, self._used = self.pieces[self._used], self._used + 1
        samples = piece.offset + len(piece.position) // len(piece.coordinates)
        self._stand_in.tell(CycleEvent.EXTENDED, piece.cycle, samples=samples)
        self._graph.next_event(CycleEvent.EXTENDED, samples=samples)
        return piece

    def is_silent_for(self, time):
        self.now += time


@pytest.fixture
def generator(graph):
    return graph.start(TrajectoryGeneratorNode)


@pytest.fixture
def commander(graph, generator, stand_in, monkeypatch):
    return Commander(graph, stand_in, graph.publisher(TwistStamped, 'jog', 10), monkeypatch)


def velocity_at_hold(piece):
    """Return the velocity with which the platform leaves a piece that is followed by another."""
    return np.reshape(piece.velocity, (-1, 4))[piece.hold - piece.offset]


def refusal(graph):
    return graph.next_event(CycleEvent.NOTICE, source='trajectory_generator').message


def test_stream_runs_as_one_cycle_that_stays(graph, commander, stand_in, machine):
    first = commander.begin(z=0.002)
    assert (first.motion, first.learning_law, first.stay, first.offset) == ('jog', 'none', True, 0)
    assert not np.any(first.velocity)
    pieces = [commander.piece(z=0.002) for _ in range(3)]
    assert {piece.cycle for piece in pieces} == {1}
    assert [piece.offset for piece in pieces] == [first.hold, pieces[0].hold, pieces[1].hold]
    np.testing.assert_allclose(velocity_at_hold(pieces[-1]), [0.0, 0.0, 0.002, 0.0], atol=1e-15)
    commander.is_silent_for(END_AFTER + PERIOD)
    graph.spin_in_silence()
    assert len(commander.pieces) == 3
    stand_in.finish(1)
    graph.next_event(CycleEvent.FINISHED)
    second = commander.begin(2, z=-0.002)  # from where the first one ended
    times = {'coordinates': machine.coordinates, 'sample_time': machine.sample_time}
    ends = [to_joints(machine, trajectory_from_msg(each, **times)).position for each in (pieces[-1], second)]
    np.testing.assert_allclose(ends[1][0], ends[0][-1], atol=1e-12)


def test_silent_stream_stops_and_is_followed_when_it_returns(commander):
    """Late messages: the platform stops within the cycle, which follows the next message."""
    commander.begin(x=0.001)
    assert velocity_at_hold(commander.piece(x=0.001)).any()
    commander.is_silent_for(SILENCE)
    assert commander.rest()
    assert any(velocity_at_hold(commander.piece(x=0.001)).any() for _ in range(3))  # one may have been due before


def test_turn_about_z_moves_phi_alone(commander):
    commander.begin(wz=0.1)
    commander.piece(wz=0.1)  # the change takes longer than a piece
    np.testing.assert_allclose(velocity_at_hold(commander.piece(wz=0.1)), [0.0, 0.0, 0.0, 0.1], atol=1e-15)


def test_cell_whose_controllers_take_no_pieces_refuses_a_jog(graph, commander, stand_in):
    """A controller of the user's own would take a piece for a cycle: it is sent none."""
    commander.send(x=0.001)
    graph.spin_until(lambda: stand_in.trajectories, 'the first piece')
    stand_in.tell(CycleEvent.STARTED, 1)
    assert refusal(graph) == 'jog: a controller of this cell takes no pieces: its LOADED event has no hold'
    commander.send(x=0.001)
    graph.spin_in_silence()
    assert not commander.pieces


def test_next_piece_waits_until_the_machine_uses_the_last_one(graph, commander):
    commander.begin(x=0.001)
    commander.send(x=0.001)
    graph.spin_until(lambda: commander.pieces, 'the second piece')
    commander.send(x=0.001)
    graph.spin_in_silence()
    assert len(commander.pieces) == 1
    commander.use()
    assert commander.piece(x=0.001).offset == commander.pieces[0].hold


@pytest.mark.parametrize(
    ('message', 'text'),
    [
        ({'x': nan}, 'jog: velocity of x is nan m/s; expected a finite number'),
        ({'x': 0.06}, 'jog: velocity of x is 0.06 m/s; allowed -0.05 to 0.05 m/s'),
        ({'wx': 0.1}, 'jog: velocity of wx is 0.1 rad/s; four_dof moves x, y, z, phi only: expected 0'),
        ({'frame': 'tool0', 'x': 0.001}, "jog: frame_id is 'tool0'; allowed: '' and 'base_link'"),
    ],
)
def test_bad_message_is_refused_and_counts_as_silence(graph, commander, stand_in, message, text):
    commander.send(**message)
    assert refusal(graph) == text
    assert not stand_in.trajectories
    commander.is_silent_for(END_AFTER)
    commander.begin(x=0.001)
    assert velocity_at_hold(commander.piece(x=0.001)).any()
    commander.is_silent_for(SILENCE)
    assert commander.rest(**message)


def test_empty_message_moves_nothing(graph, commander, stand_in):
    commander.send(frame='')
    graph.spin_in_silence()
    assert not stand_in.trajectories


def test_bytes_that_are_no_twist_are_refused(graph, commander, stand_in):
    graph.publisher(TwistStamped, 'jog', 10).publish(bytes([0, 1, 0, 0, 7]))
    assert 'message of 5 bytes is no TwistStamped' in refusal(graph)
    assert not stand_in.trajectories


class Other(PkmNode):
    """A second commander."""

    def __init__(self, **kwargs):
        super().__init__('other', **kwargs)
        self.velocity = self.create_publisher(TwistStamped, 'jog', 10)


def test_second_commander_is_refused_and_both_are_named(graph, generator, commander, stand_in):
    """With the sender of each message, as the executor of a cell tells it."""
    graph.start(Other)
    infos = generator.get_publishers_info_by_topic('/pkm/jog')
    senders = {info.node_name: bytes(info.endpoint_gid) for info in infos}

    def say(name, x):
        commander.now += 1.001 * PERIOD
        message = TwistStamped()
        message.twist.linear.x = x
        generator._jog._on_twist(serialize_message(message), senders[name])

    say('test', 0.001)
    stand_in.start(1)
    say('other', -0.001)
    expected = 'jog of /pkm/other: the jog of /pkm/test is running; wait until it has been silent for 0.3 s'
    assert refusal(graph) == expected
    say('test', 0.001)
    assert velocity_at_hold(commander.piece())[0] > 0


def test_commanders_that_cannot_be_told_apart_are_refused(graph, commander, stand_in):
    """An executor of rclpy does not tell the sender of a message: nothing moves for two of them."""
    graph.start(Other)
    commander.send(x=0.001)
    assert refusal(graph).startswith('jog: /pkm/other, /pkm/test cannot be told apart')
    assert not stand_in.trajectories


def test_jog_is_refused_while_a_goal_runs_and_vice_versa(graph, commander, goals, stand_in):
    goal = goals.send(motion=MOTION)
    stand_in.start(1)
    commander.send(x=0.001)
    assert refusal(graph).startswith(f"jog: goal 'jog of /pkm/test': motion '{MOTION}', cycle 1 of 1 is running; wait")
    stand_in.finish(1)
    goals.result(goal)
    commander.send(x=0.001)  # a stream that continues does not begin when the goal ends
    graph.spin_in_silence()
    assert {each.cycle for each in stand_in.trajectories} == {1}
    commander.is_silent_for(END_AFTER)
    commander.begin(2, x=0.001)
    _, result = goals.result(goals.send(motion=MOTION))
    assert f"goal '{MOTION}': jog of /pkm/test is running" in result.message
    graph.publisher(JointTrajectory, 'joint_trajectory_command', CYCLE_QOS).publish(JointTrajectory())
    assert 'jog of /pkm/test is running' in refusal(graph)
    client = ActionClient(graph.node, Home, 'home')
    graph.spin_until(client.server_is_ready, 'the server of home')
    sent = client.send_goal_async(Home.Goal())
    graph.spin_until(sent.done, 'the acceptance of the goal')
    result = sent.result().get_result_async()
    graph.spin_until(result.done, 'the result')
    assert 'jog of /pkm/test is running' in result.result().result.message
    client.destroy()


def test_stop_during_a_jog_ends_it_until_the_stream_pauses(graph, commander, stand_in):
    commander.begin(x=0.001)
    commander.piece(x=0.001)
    stand_in.tell(CycleEvent.FAULT, 1, message='stopped by the service machine/stop')
    assert refusal(graph) == 'jog: machine: stopped by the service machine/stop'
    number = len(commander.pieces)
    for _ in range(3):
        commander.send(x=0.001)
    graph.spin_in_silence()
    assert len(commander.pieces) == number
    assert {each.cycle for each in stand_in.trajectories} == {1}
    commander.is_silent_for(END_AFTER)
    commander.begin(2, x=0.001)


def test_jog_rests_at_the_border_and_names_the_reach(graph, commander):
    commander.begin(z=0.05)
    for _ in range(4):
        commander.piece(z=0.05)
    assert commander.rest(z=0.05)
    text = refusal(graph)
    assert text.startswith('jog: slower than commanded, or at rest: sample ')
    assert 'is out of reach; there ' in text
    assert 'z may go from ' in text
    assert any(velocity_at_hold(commander.piece(z=-0.05))[2] < 0 for _ in range(3))
