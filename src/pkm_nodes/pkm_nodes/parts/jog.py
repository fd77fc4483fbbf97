"""Streamed jog: geometry_msgs/TwistStamped on the topic jog, one recorded cycle that is extended while it runs."""

from time import monotonic

from geometry_msgs.msg import TwistStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from pkm_core.errors import PkmError, TrajectoryError
from pkm_core.motion.jog import PERIOD, JogPlanner, check_twist
from pkm_core.motion.planning import LONGEST_CYCLE
from pkm_core.servo.jog_stream import JogStream
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.runtime.groups import SenderGroup

TOPIC = 'jog'
# best effort: publishers of either kind are connected, and an old velocity need not be delivered again
_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
FRAMES = ('', 'base_link')
# [s, wall] period in which a piece that is due is looked for: a fifth of `PERIOD`
_LOOK = 3e-3


class Jog:
    """
    Takes the topic jog for `node`, the trajectory_generator.

    Refusals are reported by `commands`. A refused message counts as silence.

    Parameters
    ----------
    node : PkmNode
        Runs the coroutine of a jog in its executor.
    cycles : GoalCycles
        Has the running goal and the place where the machine stands.
    plans : GoalPlans
        Has the machine, the drives and the messages of a piece.
    commands : JointCommands
        Names senders and reports refusals.
    run : callable
        Coroutine function ``run(planned)`` that runs one cycle; `PkmError` if it does not end well.

    """

    def __init__(self, node, cycles, plans, commands, run):
        self._node, self._cycles, self._plans, self._commands, self._run = node, cycles, plans, commands, run
        self._stream = JogStream(PERIOD)
        self._planner = self._planned = None
        self._ends = {}  # (n,) [m] where the cycle ends, by its length with the pieces sent
        self._limit = ''  # why the platform moves slower than commanded
        self._topic = node.create_subscription(
            TwistStamped, TOPIC, self._on_twist, _QOS, callback_group=SenderGroup(), raw=True
        ).topic_name
        self._timer = node.create_timer(_LOOK, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()

    def _on_twist(self, data, sender=b''):
        now, name = monotonic(), self._commands.name_of(self._topic, sender)
        try:
            twist = self._read(data)
            if not sender and self._node.count_publishers(self._topic) > 1:
                raise PkmError(f'jog: {name} cannot be told apart without the fast path; allowed: one publisher')
            if not self._stream.commanded(now, name, twist, sender):
                return
            self._begin(now, name, twist, sender)
        except PkmError as refusal:
            if not self._stream.runs:
                self._stream.block(now)
            self._commands.refuse(str(refusal), TOPIC)

    def _read(self, data):
        """Return the velocities (m,) of a serialized message; `PkmError` if it is refused."""
        try:
            message = deserialize_message(data, TwistStamped)
        except (RuntimeError, ValueError, OverflowError) as error:
            raise PkmError(f'jog: message of {len(data)} bytes is no TwistStamped: {error}') from None
        if message.header.frame_id not in FRAMES:
            raise TrajectoryError(f"jog: frame_id is {message.header.frame_id!r}; allowed: '' and 'base_link'")
        linear, angular = message.twist.linear, message.twist.angular
        turns = {'wx': angular.x, 'wy': angular.y, 'phi': angular.z}
        return check_twist(self._plans.machine, {'x': linear.x, 'y': linear.y, 'z': linear.z, **turns})

    def _begin(self, now, name, twist, sender):
        self._cycles.refuse_second(f'jog of {name}')
        self._planner = JogPlanner(self._plans.machine, self._cycles.standing.position, self._plans.check)
        piece = self._planner.next(twist)
        self._planned = self._plans.of_piece(piece, TOPIC)
        self._ends, self._limit = {piece.samples: piece.end}, ''
        self._stream.begun(now, name, twist, sender)
        self._commands.accept()
        self._cycles.goal = f'jog of {name}'  # from now on another command is refused
        self._node.executor.create_task(self._perform())

    async def _perform(self):
        self._cycles.follow = self._on_event
        self._timer.reset()
        try:
            await self._run(self._planned)
        except PkmError as error:
            self._stream.stop()
            self._commands.refuse(str(error), TOPIC)
        finally:
            self._cycles.follow = None
            self._stream.ended()

    def _on_event(self, event):
        """Take STARTED or EXTENDED of the cycle."""
        if event.event == CycleEvent.STARTED and not event.hold:
            self._stream.stop()
            self._commands.refuse('jog: a controller of this cell takes no pieces: its LOADED event has no hold', TOPIC)
            return
        if event.event == CycleEvent.EXTENDED:
            if event.samples not in self._ends:
                return
            self._planned.end[:] = self._ends[event.samples]
        self._stream.accepted()
        self._look()

    def _look(self):
        """Send the next piece if it is due."""
        if not self._stream.runs:
            self._timer.cancel()
            return
        twist = self._stream.due(monotonic())
        if twist is None:
            return
        if self._planner.is_long and self._planner.rests:
            self._stream.stop()
            self._cycles.publish_notice(
                f'jog: ends after {LONGEST_CYCLE:g} s, the longest cycle; pause, then jog again'
            )
            return
        try:
            piece = self._planner.next(twist)
        except PkmError as error:
            self._stream.stop()
            self._commands.refuse(f'jog: stops: {error}', TOPIC)
            return
        self._ends = {piece.samples: piece.end}
        for topic, message in self._plans.of_piece(piece, TOPIC).first:
            self._cycles.send(topic, message)
        if piece.limited and not self._limit:
            self._cycles.publish_notice(f'jog: slower than commanded, or at rest: {piece.limited}')
        self._limit = piece.limited
