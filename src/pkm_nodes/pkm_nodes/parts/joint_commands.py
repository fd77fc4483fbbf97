"""Commands by topic: trajectory_msgs/JointTrajectory, run as one recorded cycle that stays where it ends."""

from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from pkm_core.errors import PkmError
from pkm_core.motion.joint_command import Point, describe_samples, sampled_command
from pkm_core.motion.trajectory import checked_joints
from pkm_nodes.messages.conversions import seconds_of
from pkm_nodes.messages.diagnostics import GOAL, REFUSAL, REFUSED_COMMANDS, STATE, diagnostics
from pkm_nodes.runtime.groups import SenderGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CYCLE_QOS

TOPIC = 'joint_trajectory_command'


class JointCommands:
    """
    Takes joint_trajectory_command for `node`, the trajectory_generator, and publishes its diagnostics.

    A refusal is a line in the log, a NOTICE event and a warning in the diagnostics until the next command is taken.

    Parameters
    ----------
    node : PkmNode
        Runs the coroutine of a command in its executor.
    cycles : GoalCycles
        Has the running goal and the place where the machine stands.
    plans : GoalPlans
        Checks a command by the model of the drives.
    run : callable
        Coroutine function ``run(planned)`` that runs one cycle; `PkmError` if it does not end well.

    """

    def __init__(self, node, cycles, plans, run):
        self._node, self._cycles, self._plans, self._run = node, cycles, plans, run
        self._refused, self._refusal, self._told = 0, '', 0.0
        self._log = LogThrottle(node.get_logger(), is_error=True)
        self._topic = node.create_subscription(
            JointTrajectory, TOPIC, self._on_command, CYCLE_QOS, callback_group=SenderGroup(), raw=True
        ).topic_name
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        node.create_timer(1.0, self._publish_diagnostics, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_command(self, data, sender=b''):
        try:
            message = _read(data)
            name = self.name_of(self._topic, sender)
            self._cycles.refuse_second(f'{TOPIC} of {name}')
            _, planned = plan_command(self._plans, message, self._cycles.standing.position, TOPIC)
        except PkmError as refusal:
            self.refuse(str(refusal))
            return
        self.accept()
        self._cycles.goal = f'{TOPIC} of {name}'  # from now on another one is refused
        self._node.executor.create_task(self._perform(planned))

    async def _perform(self, planned):
        try:
            await self._run(planned)
        except PkmError as error:
            self.refuse(str(error))

    def accept(self):
        """Note that a command is accepted: the last refusal is no longer a warning."""
        self._refusal = ''

    def refuse(self, reason, topic=TOPIC):
        """Report why a command on `topic` was refused; of a stream, the same reason once per second."""
        self._refused, before, self._refusal = self._refused + 1, self._refusal, reason
        self._log(f'{self._node.resolve_topic_name(topic)}: refused: {reason}', topic)
        now = monotonic()
        if topic == TOPIC or reason != before or now - self._told >= 1.0:
            self._told = now
            self._cycles.publish_notice(reason if reason.startswith(topic) else f'{topic}: {reason}')

    def name_of(self, topic, sender):
        """Return the node that sent a message on `topic`, or all nodes that may have if its GID is unknown."""
        infos = self._node.get_publishers_info_by_topic(topic)
        names = {bytes(info.endpoint_gid): f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos}
        return names.get(sender) or ', '.join(sorted(set(names.values()))) or 'a node that has left'

    def _publish_diagnostics(self):
        goal = self._cycles.goal
        level = DiagnosticStatus.WARN if self._refusal else DiagnosticStatus.OK
        values = {STATE: 'running' if goal else 'standing', GOAL: goal}
        values |= {REFUSED_COMMANDS: self._refused, REFUSAL: self._refusal}
        text = f'last command refused: {self._refusal}' if self._refusal else goal or 'no goal'
        stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostics(self._node, level, text, values, stamp))


def plan_command(plans, message, start, name):
    """
    Return the `SampledTrajectory` in joints and the `PlannedGoal` of a JointTrajectory; `PkmError` if it is refused.

    Parameters
    ----------
    plans : GoalPlans
        Has the machine, and checks by the model of the drives.
    message : trajectory_msgs.msg.JointTrajectory
        The command.
    start : ndarray, shape (n,)
        Joint positions where the machine stands [m].
    name : str
        Of the motion in the bag.

    """
    machine = plans.machine
    joints = sampled_command(machine, message.joint_names, _points(message), start)
    try:
        checked_joints(machine, joints)
        return joints, plans.of_joints(joints, name)
    except PkmError as error:
        raise PkmError(f'joint {error} ({describe_samples(machine)})') from None


def _read(data):
    try:
        return deserialize_message(data, JointTrajectory)
    except (RuntimeError, ValueError, OverflowError) as error:
        raise PkmError(f'message of {len(data)} bytes is no JointTrajectory: {error}') from None


def _points(message):
    return [
        Point(
            seconds_of(each.time_from_start),
            tuple(each.positions),
            tuple(each.velocities),
            tuple(each.accelerations),
            tuple(each.effort),
        )
        for each in message.points
    ]
