"""
Node `trajectory_generator`: the action execute_motion in, one pose_trajectory a cycle out.

It leads a motion through its cycles: publish the trajectory, wait until the machine has run it, go on. A trajectory is
sent again every second until the machine starts the cycle, so it does not matter which node came up last. A machine
tells the end of its cycle; only one that is gone does not: its cycle is given up with a STOP event. An experiment of
identification is planned in joints: with its pose_trajectory go the joint_trajectory itself and the excitation.
"""

import sys
from math import inf, nan
from pathlib import Path

from rclpy.action import ActionServer, CancelResponse
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.task import Future
from std_msgs.msg import UInt32

from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.errors import PkmError, TrajectoryError
from pkm_core.identification.plan import in_poses
from pkm_core.learning import make_law
from pkm_core.learning.initial import first_feedforward
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan, poses_motion
from pkm_core.motion.trajectory import checked_joints, to_joints
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleEvent, CycleMetrics, Excitation
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_nodes.messages.conversions import trajectory_from_msg, trajectory_to_msg
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.parts.presence import Presence
from pkm_nodes.runtime.node import CYCLE_QOS, LAST_VALUE_QOS, PkmNode, run


class TrajectoryGeneratorNode(PkmNode):
    """Action server of the cell: plans a motion and leads it through its cycles."""

    def __init__(self, **kwargs):
        super().__init__('trajectory_generator', **kwargs)
        self._machine = load_machine(self.setting('machine', 'four_dof', 'machine of config/machines, or a YAML file'))
        self._chosen = self.setting('control', 'robust', 'of the controllers, as they are started')
        self._control = choose_control(self._machine, self._chosen)
        self._start_timeout = self.setting('start_timeout', 30.0, '[s, wall] from a trajectory to the first tick')
        self._metrics_timeout = self.setting('metrics_timeout', 2.0, '[s, wall] from the last tick to the metrics')
        self.check_settings()
        self._cycle = 0
        self._goal = None  # what is running, in words
        self._outcome = None  # Future of the running cycle: None or the reason why it ended
        self._pending = ()  # (publisher, message) of the running cycle, to send again
        self._deadline = inf
        self._running_machine = None  # Presence, while a cycle runs
        self._metrics = {}
        self._all_metrics = None  # Future: the metrics of all joints are here
        self._poses = self.create_publisher(SampledTrajectoryMessage, 'pose_trajectory', CYCLE_QOS)
        self._joints = self.create_publisher(SampledTrajectoryMessage, 'joint_trajectory', CYCLE_QOS)
        self._excitation = self.create_publisher(Excitation, 'excitation', CYCLE_QOS)
        for joint in self._machine.joints:
            self.create_subscription(CycleMetrics, f'{joint}/cycle_metrics', self._on_metrics, CYCLE_QOS)
        self._events = CycleEvents(self, 'trajectory_generator')
        subscribe_events(self, self._on_event)
        self.create_subscription(UInt32, 'machine/cycle', self._on_machine_cycle, LAST_VALUE_QOS)
        self._wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._look_after, clock=self._wall)
        self.offer('trajectory_generator/reload', self._reload)
        self._server = ActionServer(
            self, ExecuteMotion, 'execute_motion', self._execute, cancel_callback=lambda _: CancelResponse.ACCEPT
        )

    def _reload(self):
        """Take up the gains that the configuration has now: laws are tested for them before a goal begins."""
        self._control = choose_control(self._machine, self._chosen)

    async def _execute(self, goal_handle):
        """Run one goal; a refused one is aborted at once, because only a result can say why."""
        result = ExecuteMotion.Result()
        try:
            self._refuse_second_goal(goal_handle.request)
            name, first, later = self._plan(goal_handle.request)
        except PkmError as error:
            self.get_logger().error(f'goal refused: {error}')
            result.message = str(error)
            goal_handle.abort()
            return result
        cycles = goal_handle.request.cycles
        try:
            for number in range(1, cycles + 1):
                self._goal = f'motion {name!r}, cycle {number} of {cycles}'
                result.message = await self._run_cycle(first if number == 1 else later)
                if result.message:
                    self.get_logger().error(f'{self._goal}: {result.message}')
                    goal_handle.abort()
                    return result
                result.cycles_completed = number
                await self._publish_feedback(goal_handle, number)
                if goal_handle.is_cancel_requested and number < cycles:
                    result.message = f'cancelled after cycle {number} of {cycles}; the machine stands at home'
                    goal_handle.canceled()
                    return result
            goal_handle.succeed()
            return result
        finally:
            self._goal = None

    def _refuse_second_goal(self, request):
        if self._goal is not None:
            name = request.motion or request.experiment.motion or 'poses'
            raise TrajectoryError(f'goal {name!r}: {self._goal} is running; wait for its end or cancel it')

    def _plan(self, request):
        """
        Return the name of a goal that can be run as a whole, and what to send, [(publisher, message)].

        First for its first cycle, then for all others.
        """
        if not request.cycles:
            raise TrajectoryError('goal: cycles is 0; expected at least 1')
        kind = kind_of(self._control)
        if request.controller not in ('', kind):
            raise TrajectoryError(f'goal: controller {request.controller!r}; this cell has been started with {kind!r}')
        experiment = request.experiment
        if bool(request.motion) + bool(request.poses) + bool(experiment.coordinates) != 1:
            raise TrajectoryError(
                f'goal: motion {request.motion!r}, {len(request.poses)} poses and experiment {experiment.motion!r}; '
                f'give one of them'
            )
        if request.motion and request.move_time != 0:
            raise TrajectoryError(
                f'goal: move_time is {request.move_time} s; motion {request.motion!r} has its own, expected 0'
            )
        if experiment.coordinates:
            return self._plan_experiment(request)
        machine = self._machine
        if request.motion:
            motion, name = load_motion(request.motion), Path(request.motion).stem
        else:
            poses = [[getattr(pose, name) for name in machine.coordinates] for pose in request.poses]
            motion, name = poses_motion(machine, poses, request.move_time or None), 'poses'
        trajectory = plan(machine, motion)
        joints = to_joints(machine, trajectory)  # refuses here what inverse_kinematics would after the goal was taken
        named = {'cycle': 0, 'motion': name, 'learning_law': request.learning_law or 'none'}
        begin = self._begin_learning(request, name, joints)
        return name, *(
            [(self._poses, trajectory_to_msg(trajectory, **named, feedforward=each))] for each in (begin, None)
        )

    def _begin_learning(self, request, name, joints):
        """
        Return the learned feedforward a goal begins with, or None; its law has passed the convergence test.

        Before anything moves a law is refused that would diverge, and a file that is for something else.
        """
        law = request.learning_law or 'none'
        if law != 'none':
            self.get_logger().info(make_law(law, self._machine, self._control).verdict)
        if not request.learned:
            return None
        return first_feedforward(request.learned, self._machine, name, law, self._control, joints)

    def _plan_experiment(self, request):
        """Return what `_plan` does, of an experiment of identification."""
        machine, experiment = self._machine, request.experiment
        if kind_of(self._control) != 'robust':
            raise TrajectoryError(
                f'goal: experiment {experiment.motion!r}; only a cell with robust control has excitation'
            )
        if request.learning_law not in ('', 'none') or request.move_time != 0:
            raise TrajectoryError(
                f'goal: learning_law {request.learning_law!r} and move_time {request.move_time} s with experiment '
                f"{experiment.motion!r}; expected 'none' and 0"
            )
        excited = [excitation.joint for excitation in request.excitation]
        if sorted(excited) != sorted(machine.joints):
            raise TrajectoryError(f'goal: excitation of {excited}; expected one of each of {list(machine.joints)}')
        joints = trajectory_from_msg(experiment, coordinates=machine.joints, sample_time=machine.sample_time)
        checked_joints(machine, joints)
        named = {'cycle': 0, 'motion': experiment.motion, 'kind': SampledTrajectoryMessage.IDENTIFICATION}
        messages = [
            *((self._excitation, excitation) for excitation in request.excitation),
            (self._poses, trajectory_to_msg(in_poses(machine, joints), **named)),
            (self._joints, trajectory_to_msg(joints, **named)),
        ]
        return experiment.motion, messages, messages

    def _run_cycle(self, messages):
        """Send the messages of the next cycle; the returned future gives '' when it has run, or why it has not."""
        self._cycle += 1
        self._metrics, self._all_metrics = {}, Future()
        self._outcome = Future()
        self._deadline = self._seconds() + self._start_timeout
        self._pending = messages
        for _, message in messages:
            message.cycle = self._cycle
        self._publish_pending()
        return self._outcome

    def _publish_pending(self):
        for publisher, message in self._pending:
            publisher.publish(message)

    def _look_after(self):
        """Send the trajectory of a cycle that has not started again, and wait for nobody for ever."""
        now = self._seconds()
        if self._pending and now > self._deadline:
            heard = self.count_subscribers(self._poses.topic_name)
            self._end_cycle(
                f'cycle {self._cycle} did not start within {self._start_timeout} s; {heard} node(s) listen to '
                f'{self._poses.topic_name}: are inverse_kinematics, joint_controllers and machine running?'
            )
        elif self._pending:
            self._publish_pending()
        elif self._running_machine is not None and self._running_machine.has_ended():
            reason = 'the machine that ran it is gone: its process has ended, or is out of reach; start it again'
            self._events.publish(CycleEvent.STOP, self._cycle, message=reason)  # frees the controllers
            self._end_cycle(f'cycle {self._cycle}: {reason}')
        elif self._all_metrics is not None and not self._all_metrics.done() and now > self._deadline:
            self._all_metrics.set_result(None)

    def _on_machine_cycle(self, message):
        """Never number a cycle like one the machine has run, also not after a restart of this node."""
        self._cycle = max(self._cycle, message.data)

    def _on_event(self, event):
        if event.cycle != self._cycle or self._outcome is None:
            return
        if event.event == CycleEvent.STARTED:
            self._pending = ()
            self._deadline = inf
            self._running_machine = Presence(self, 'machine/cycle')
        elif event.event == CycleEvent.FINISHED:
            self._deadline = self._seconds() + self._metrics_timeout
            self._end_cycle('')
            self._end_metrics_if_complete()
        elif event.event in (CycleEvent.REFUSED, CycleEvent.FAULT):
            self._end_cycle(f'{event.source}: {event.message}')

    def _end_cycle(self, reason):
        self._pending, self._running_machine = (), None
        if self._outcome is not None and not self._outcome.done():
            self._outcome.set_result(reason)

    def _on_metrics(self, metrics):
        if metrics.cycle != self._cycle or self._all_metrics is None:
            return
        self._metrics[metrics.joint] = metrics.max_dynamic_error
        self._end_metrics_if_complete()

    def _end_metrics_if_complete(self):
        """Wait for no more metrics when all have come; a controller that is not ours need not tell any."""
        told = [joint for joint in self._machine.joints if self.count_publishers(f'{joint}/cycle_metrics')]
        if self._metrics.keys() >= set(told) and not self._all_metrics.done():
            self._all_metrics.set_result(None)

    async def _publish_feedback(self, goal_handle, cycle):
        await self._all_metrics
        joints = self._machine.joints
        goal_handle.publish_feedback(
            ExecuteMotion.Feedback(
                cycle=cycle,
                joints=list(joints),
                max_dynamic_error=[self._metrics.get(joint, nan) for joint in joints],
            )
        )

    def _seconds(self):
        return self._wall.now().nanoseconds * 1e-9

    def destroy_node(self):
        """Destroy the action server too; a node does not do so by itself."""
        self._server.destroy()
        super().destroy_node()


def make_nodes():
    """Return this process's node."""
    return [TrajectoryGeneratorNode()]


def main(args=None):
    """Run the node as a process of its own."""
    sys.exit(run(make_nodes, args))
