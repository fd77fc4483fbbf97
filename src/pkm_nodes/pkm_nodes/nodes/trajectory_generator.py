"""
Node `trajectory_generator`: the action execute_motion in, one pose_trajectory per cycle out.

A goal is run cycle by cycle: publish the trajectory, wait until the machine has run it, begin the next cycle. The
trajectory is resent every second until the machine starts the cycle, so the nodes may start in any order. When the
process of the machine disappears during a cycle, the cycle ends with a STOP event. An experiment of identification is
planned in joints: its joint_trajectory and excitation are published with its pose_trajectory.

The node plans, converts messages and performs actions. `GoalCycle` decides when to resend and when a cycle has ended.
"""

from math import nan
from pathlib import Path
from time import monotonic

from rclpy.action import CancelResponse
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.task import Future
from std_msgs.msg import UInt32

from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.control.feasibility import drive_check
from pkm_core.control.model import load_model
from pkm_core.errors import PkmError, TrajectoryError
from pkm_core.identification.plan import in_poses
from pkm_core.learning import make_law
from pkm_core.learning.initial import first_feedforward
from pkm_core.machines.geometry import load_geometry
from pkm_core.motion.planning import load_motion, plan, pose_rows, poses_motion, still_moves
from pkm_core.motion.trajectory import checked_joints, to_joints
from pkm_core.servo.goal_cycle import End, GoalCycle, Send, StopCycle, WatchMachine
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleEvent, CycleMetrics, Excitation, PlatformPose
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_nodes.messages.conversions import trajectory_from_msg, trajectory_to_msg
from pkm_nodes.messages.diagnostics import CYCLE, FAULT, STATE, values_of
from pkm_nodes.parts.cell_geometry import CellGeometry
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.parts.machine_status import subscribe_machine_status
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.parts.presence import Presence
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CALIBRATED, CYCLE_QOS, LAST_VALUE_QOS, PkmNode, entry_point
from pkm_nodes.runtime.session import require_session


class TrajectoryGeneratorNode(PkmNode):
    """Action server of the cell: plans a motion and runs its cycles one after the other."""

    def __init__(self, **kwargs):
        super().__init__('trajectory_generator', **kwargs)
        geometry = load_geometry(self.machine_setting(), self.configuration_setting())
        self._chosen = self.control_setting()
        self._gains, self._models = choose_control(geometry.machine, self._chosen), load_model(geometry.machine)
        calibrated = self.setting('calibrated', 'calibrated', CALIBRATED)
        start_timeout = self.setting('start_timeout', 30.0, '[s, wall] from a trajectory to the first tick')
        metrics_timeout = self.setting('metrics_timeout', 2.0, '[s, wall] from the last tick to the metrics')
        silence = self.setting(
            'machine_timeout', 12.0, '[s, wall] without diagnostics of the machine until it is stuck'
        )
        self.check_settings()
        self._log_refusal = LogThrottle(self.get_logger(), is_error=True)
        self._goal = ''  # the running goal and cycle, or another work that keeps goals out, in words
        self._geometry = NodeGeometry(self, geometry)
        self._cell_geometry = CellGeometry(self, self._geometry, calibrated, self._occupy, self._publish_notice)
        self._cycle = GoalCycle(start_timeout, metrics_timeout, silence)
        self._messages = []  # (publisher, message) of the last cycle
        self._ended = Future()  # End of the last cycle
        self._poses = self.create_publisher(SampledTrajectoryMessage, 'pose_trajectory', CYCLE_QOS)
        self._joints = self.create_publisher(SampledTrajectoryMessage, 'joint_trajectory', CYCLE_QOS)
        self._excitation = self.create_publisher(Excitation, 'excitation', CYCLE_QOS)
        for joint in self._machine.joints:
            subscribe_one(self, CycleMetrics, f'{joint}/cycle_metrics', self._on_metrics, CYCLE_QOS)
        self._events = CycleEvents(self, 'trajectory_generator')
        used = CycleEvent.STARTED, CycleEvent.FINISHED, CycleEvent.REFUSED, CycleEvent.FAULT
        subscribe_events(self, self._on_event, self._machine.joints, kinds=used)
        subscribe_one(self, UInt32, 'machine/cycle', self._on_machine_cycle, LAST_VALUE_QOS)
        subscribe_machine_status(self, self._on_machine_status)
        self._machine_presence = Presence(self, 'machine/cycle')
        self.create_timer(1.0, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.offer('trajectory_generator/reload', self._reload)
        self._server = self.serve_action(
            ExecuteMotion, 'execute_motion', self._execute, lambda _: CancelResponse.ACCEPT
        )

    @property
    def _machine(self):
        return self._geometry.machine

    def _reload(self):
        """Read the gains of the configuration again; learning laws are checked with them before a goal begins."""
        self._gains, self._models = choose_control(self._machine, self._chosen), load_model(self._machine)

    async def _execute(self, goal_handle):
        """Run one goal. A refused goal is accepted and aborted, because only a result carries the reason."""
        result = ExecuteMotion.Result(session=self.session)
        try:
            require_session('goal', goal_handle.request.session, self.session)
            self._refuse_second_goal(goal_handle.request)
            name, first, later = self._plan(goal_handle.request)
        except PkmError as error:
            self._log_refusal(f'goal refused: {error}', 'goals')
            result.message = str(error)
            goal_handle.abort()
            return result
        cycles = goal_handle.request.cycles
        try:
            for number in range(1, cycles + 1):
                self._goal = f'motion {name!r}, cycle {number} of {cycles}'
                await self._cell_geometry.align()
                end = await self._run_cycle(first if number == 1 else later)
                if end.reason:
                    result.message = end.reason
                    self.get_logger().error(f'{self._goal}: {result.message}')
                    goal_handle.abort()
                    return result
                result.cycles_completed = number
                self._publish_feedback(goal_handle, number, end.errors)
                if goal_handle.is_cancel_requested and number < cycles:
                    result.message = f'cancelled after cycle {number} of {cycles}; the machine stands at home'
                    goal_handle.canceled()
                    return result
            goal_handle.succeed()
            return result
        except PkmError as error:  # a node keeps another geometry
            result.message = str(error)
            self.get_logger().error(f'{self._goal}: {error}')
            goal_handle.abort()
            return result
        finally:
            self._goal = ''

    def _refuse_second_goal(self, request):
        if self._goal:
            name = request.motion or request.experiment.motion or 'poses'
            raise TrajectoryError(f'goal {name!r}: {self._goal} is running; wait for its end or cancel it')

    def _occupy(self, what):
        """Keep goals out during the work `what`, or let them in again ('')."""
        if what and (self._goal or self._cycle.is_on_machine):
            running = self._goal or f'cycle {self._cycle.cycle}'
            raise TrajectoryError(f'{what}: {running} is running; wait for its end or cancel it')
        self._goal = what

    def _publish_notice(self, text):
        self._events.publish(CycleEvent.NOTICE, self._cycle.next_cycle, message=text)

    def _plan(self, request):
        """
        Return the name of a goal and its messages, [(publisher, message)]: of the first cycle, and of each later one.

        `TrajectoryError` unless all cycles of the goal can be run.
        """
        if not request.cycles:
            raise TrajectoryError('goal: cycles is 0; expected at least 1')
        kind = kind_of(self._gains)
        if request.controller not in ('', kind):
            raise TrajectoryError(f'goal: controller {request.controller!r}; this cell has been started with {kind!r}')
        experiment = request.experiment
        if bool(request.motion) + bool(request.poses) + bool(experiment.coordinates) != 1:
            raise TrajectoryError(
                f'goal: motion {request.motion!r}, {len(request.poses)} poses and experiment {experiment.motion!r}; '
                f'give one of them'
            )
        for name in ('move_time', 'rest_time'):
            value = getattr(request, name)
            if request.motion and value != 0:
                raise TrajectoryError(f'goal: {name} is {value} s; motion {request.motion!r} has its own, expected 0')
        if experiment.coordinates:
            return self._plan_experiment(request)
        machine = self._machine
        if request.motion:
            motion, name = load_motion(request.motion), Path(request.motion).stem
        else:
            names = PlatformPose.get_fields_and_field_types()
            poses = pose_rows(machine, [{name: getattr(pose, name) for name in names} for pose in request.poses])
            times = request.move_time or None, request.rest_time or None
            motion, name = poses_motion(machine, poses, *times), 'poses'
        trajectory = plan(machine, motion, drive_check(machine, self._models))
        joints = to_joints(machine, trajectory)  # refuses what inverse_kinematics would refuse after the start
        still = still_moves(machine, joints)
        if still:
            self.get_logger().warning(f'{name}: {still}')
        named = {'cycle': 0, 'motion': name, 'learning_law': request.learning_law or 'none'}
        named['geometry'] = self._geometry.geometry.digest
        begin = self._begin_learning(request, name, joints)
        return name, *(
            [(self._poses, trajectory_to_msg(trajectory, **named, feedforward=each))] for each in (begin, None)
        )

    def _begin_learning(self, request, name, joints):
        """
        Return the learned feedforward (N, n) [V] of the first cycle, or None.

        Refuses, before anything moves, a law that would diverge and a file learned for something else.
        """
        law = request.learning_law or 'none'
        if law != 'none':
            self.get_logger().info(make_law(law, self._machine, self._gains).verdict)
        if not request.learned:
            return None
        return first_feedforward(request.learned, self._machine, name, law, self._gains, joints)

    def _plan_experiment(self, request):
        """Return the same as `_plan` for an experiment of identification."""
        machine, experiment = self._machine, request.experiment
        if kind_of(self._gains) != 'robust':
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
        named['geometry'] = self._geometry.geometry.digest
        messages = [
            *((self._excitation, excitation) for excitation in request.excitation),
            (self._poses, trajectory_to_msg(in_poses(machine, joints), **named)),
            (self._joints, trajectory_to_msg(joints, **named)),
        ]
        return experiment.motion, messages, messages

    def _run_cycle(self, messages):
        """Begin the next cycle with these messages and return the future of its `End`."""
        self._messages, self._ended = messages, Future()
        self._perform(self._cycle.begin(monotonic()))
        return self._ended

    def _look(self):
        listeners = f'{self.count_subscribers(self._poses.topic_name)} node(s) listen to {self._poses.topic_name}'
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
        if event.event == CycleEvent.STARTED:
            self._perform(self._cycle.started(event.cycle))
        elif event.event == CycleEvent.FINISHED:
            self._perform(self._cycle.finished(event.cycle, monotonic(), self._joints_with_metrics()))
        elif event.event in (CycleEvent.REFUSED, CycleEvent.FAULT):
            self._perform(self._cycle.failed(event.cycle, f'{event.source}: {event.message}'))

    def _on_metrics(self, metrics):
        joint, error = metrics.joint, metrics.max_dynamic_error
        self._perform(self._cycle.metrics(metrics.cycle, joint, error, self._joints_with_metrics()))

    def _joints_with_metrics(self):
        """Return the joints whose controller publishes metrics; a controller of the user's own need not."""
        return [joint for joint in self._machine.joints if self.count_publishers(f'{joint}/cycle_metrics')]

    def _perform(self, actions):
        for action in actions:
            match action:
                case Send(cycle):
                    self._events.publish(CycleEvent.ANNOUNCED, cycle, message=self._goal)
                    for publisher, message in self._messages:
                        message.cycle = cycle
                        publisher.publish(message)
                case WatchMachine():
                    self._machine_presence = Presence(self, 'machine/cycle')
                case StopCycle(cycle, reason):
                    self._events.publish(CycleEvent.STOP, cycle, message=reason)
                case End():
                    self._ended.set_result(action)

    def _publish_feedback(self, goal_handle, cycle, errors):
        joints = self._machine.joints
        goal_handle.publish_feedback(
            ExecuteMotion.Feedback(
                session=self.session,
                cycle=cycle,
                joints=list(joints),
                max_dynamic_error=[errors.get(joint, nan) for joint in joints],
            )
        )

    def destroy_node(self):
        """Destroy the action server first; `Node` does not destroy it."""
        self._server.destroy()
        super().destroy_node()


main = entry_point(TrajectoryGeneratorNode)
