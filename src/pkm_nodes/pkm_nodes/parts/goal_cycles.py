"""The cycles of the goals of a cell, one goal at a time: send, resend, follow, and report the end."""

from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.task import Future
from std_msgs.msg import UInt32

from pkm_core.errors import TrajectoryError
from pkm_core.servo.goal_cycle import End, Send, StopCycle, WatchMachine
from pkm_interfaces.msg import CycleEvent, CycleMetrics, Excitation, SampledTrajectory
from pkm_nodes.messages.diagnostics import CYCLE, FAULT, STATE, values_of
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.parts.follow_standing import follow_standing
from pkm_nodes.parts.machine_status import subscribe_machine_status
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.parts.presence import Presence
from pkm_nodes.runtime.node import CYCLE_QOS, LAST_VALUE_QOS

_FOLLOWED = CycleEvent.STARTED, CycleEvent.EXTENDED


class GoalCycles:
    """
    Publishes the trajectories of `node`, the trajectory_generator, and follows their cycles.

    `GoalCycle` decides when to resend and when a cycle has ended.

    Parameters
    ----------
    node : PkmNode
    machine : Machine
        For its joints and its home.
    cycle : GoalCycle

    Attributes
    ----------
    goal : str
        The running goal and cycle, or another work that keeps goals out, in words; '' without one.
    standing : Standing
        Where the next cycle begins.
    number : int
        Number of the last cycle that was begun.
    first_tick : int or None
        Machine tick at which it started, None before.
    follow : callable or None
        ``follow(event)`` takes STARTED and EXTENDED of the running cycle.

    """

    def __init__(self, node, machine, cycle):
        self._node, self._machine, self._cycle = node, machine, cycle
        self.goal, self.follow = '', None
        self.first_tick = None
        self._messages = []  # (topic, message) of the last cycle
        self._ended = Future()  # End of the last cycle
        self._publishers = {
            'pose_trajectory': node.create_publisher(SampledTrajectory, 'pose_trajectory', CYCLE_QOS),
            'joint_trajectory': node.create_publisher(SampledTrajectory, 'joint_trajectory', CYCLE_QOS),
            'excitation': node.create_publisher(Excitation, 'excitation', CYCLE_QOS),
        }
        for joint in machine.joints:
            subscribe_one(node, CycleMetrics, f'{joint}/cycle_metrics', self._on_metrics, CYCLE_QOS)
        self._events = CycleEvents(node, node.get_name())
        used = CycleEvent.STARTED, CycleEvent.FINISHED, CycleEvent.REFUSED, CycleEvent.FAULT, CycleEvent.RESET
        used = *used, CycleEvent.EXTENDED
        subscribe_events(node, self._on_event, machine.joints, kinds=used)
        subscribe_one(node, UInt32, 'machine/cycle', self._on_machine_cycle, LAST_VALUE_QOS)
        subscribe_machine_status(node, self._on_machine_status)
        self.standing = follow_standing(node, machine)
        self._machine_presence = Presence(node, 'machine/cycle')
        node.create_timer(1.0, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def number(self):
        """Number of the last cycle that was begun."""
        return self._cycle.cycle

    def refuse_second(self, name):
        """Raise `TrajectoryError` for the goal `name` while another one runs."""
        if self.goal:
            raise TrajectoryError(f'goal {name!r}: {self.goal} is running; wait for its end or cancel it')

    def occupy(self, what):
        """Keep goals out during the work `what`, or let them in again ('')."""
        if what and (self.goal or self._cycle.is_on_machine):
            running = self.goal or f'cycle {self._cycle.cycle}'
            raise TrajectoryError(f'{what}: {running} is running; wait for its end or cancel it')
        self.goal = what

    def send(self, topic, message):
        """Publish a further message of the running cycle."""
        message.cycle = self._cycle.cycle
        self._publishers[topic].publish(message)

    def publish_notice(self, text):
        """Publish a NOTICE event of the next cycle."""
        self._events.publish(CycleEvent.NOTICE, self._cycle.next_cycle, message=text)

    async def run(self, planned, goal, later=False):
        """
        Run one cycle of a `PlannedGoal` and return its `End`.

        Parameters
        ----------
        planned : PlannedGoal
            Its messages.
        goal : str
            The goal and its cycle, in words.
        later : bool
            Whether it is not the first cycle of the goal.

        """
        self.goal, self.first_tick = goal, None
        self._messages, self._ended = planned.later if later else planned.first, Future()
        self._perform(self._cycle.begin(monotonic()))
        end = await self._ended
        if not end.reason:
            self.standing.ended(self._cycle.cycle, planned.end)
        return end

    def stop(self, reason):
        """Brake in the running cycle, or as soon as it starts; the machine then waits for its reset."""
        self._perform(self._cycle.stop(reason))

    def _look(self):
        topic = self._publishers['pose_trajectory'].topic_name
        listeners = f'{self._node.count_subscribers(topic)} node(s) listen to {topic}'
        machine_ended = self._cycle.is_on_machine and self._machine_presence.has_ended()
        self._perform(self._cycle.look(monotonic(), machine_ended, listeners))

    def _on_machine_cycle(self, message):
        self._perform(self._cycle.numbered(message.data))

    def _on_machine_status(self, status):
        values = values_of(status)
        cycle = values.get(CYCLE, '')
        if cycle.isdecimal():
            facts = values.get(STATE, ''), int(cycle), values.get(FAULT, ''), self._joints_with_metrics()
            self._perform(self._cycle.reported(monotonic(), *facts))

    def _on_event(self, event):
        if self.follow and event.cycle == self._cycle.cycle and event.event in _FOLLOWED:
            self.follow(event)
        if event.event == CycleEvent.STARTED:
            if event.cycle == self._cycle.cycle:
                self.first_tick = event.tick
            self._perform(self._cycle.started(event.cycle))
        elif event.event == CycleEvent.FINISHED:
            self._perform(self._cycle.finished(event.cycle, monotonic(), self._joints_with_metrics()))
        elif event.event in (CycleEvent.REFUSED, CycleEvent.FAULT):
            self._perform(self._cycle.failed(event.cycle, f'{event.source}: {event.message}'))
        elif event.event == CycleEvent.RESET:
            self.standing.reset()

    def _on_metrics(self, metrics):
        joint, error = metrics.joint, metrics.max_dynamic_error
        self._perform(self._cycle.metrics(metrics.cycle, joint, error, self._joints_with_metrics()))

    def _joints_with_metrics(self):
        """Return the joints whose controller publishes metrics; a controller of the user's own need not."""
        return [joint for joint in self._machine.joints if self._node.count_publishers(f'{joint}/cycle_metrics')]

    def _perform(self, actions):
        for action in actions:
            match action:
                case Send(cycle):
                    self._events.publish(CycleEvent.ANNOUNCED, cycle, message=self.goal)
                    for topic, message in self._messages:
                        self.send(topic, message)
                case WatchMachine():
                    self._machine_presence = Presence(self._node, 'machine/cycle')
                case StopCycle(cycle, reason):
                    self._events.publish(CycleEvent.STOP, cycle, message=reason)
                case End():
                    self._ended.set_result(action)
