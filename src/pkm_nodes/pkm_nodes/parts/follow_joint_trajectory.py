"""
The action control_msgs/FollowJointTrajectory, run as one recorded cycle that stays where it ends.

Package control_msgs is not among the wheels that the project is set up from; a ROS installation has it.
"""

import importlib
from functools import partial

import numpy as np
from rclpy.action import CancelResponse
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from pkm_core.errors import FollowError, PkmError
from pkm_core.motion.tolerances import JointTolerance, check_start, tolerances_of
from pkm_interfaces.msg import CycleError, Standing
from pkm_nodes.messages.conversions import duration_of, nanoseconds_of_standstill, seconds_of
from pkm_nodes.parts.joint_commands import plan_command
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.parts.waiting import Waiting
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CYCLE_QOS, LAST_VALUE_QOS

NAME = 'follow_joint_trajectory'
# [s, wall] from the metrics of a cycle to its errors, which the controllers publish before
_ERRORS_WITHIN = 2.0


def find_action():
    """Return the class FollowJointTrajectory of package control_msgs, None where it is not installed."""
    try:
        return importlib.import_module('control_msgs.action').FollowJointTrajectory
    except ImportError:
        return None


class FollowJointTrajectory:
    """
    Serves the action for `node`, the trajectory_generator.

    A refused goal is accepted and aborted, because only a result carries the reason.

    Parameters
    ----------
    node : PkmNode
    cycles : GoalCycles
        Has the running goal and the place where the machine stands.
    plans : GoalPlans
        Checks a trajectory by the model of the drives.
    run : callable
        Coroutine function ``run(planned, goal, is_cancelled=...)`` that runs one cycle; `PkmError` if it does not end
        well.
    action : type
        From `find_action`.

    Attributes
    ----------
    server : ActionServer

    """

    def __init__(self, node, cycles, plans, run, action):
        self._node, self._cycles, self._plans, self._run, self._action = node, cycles, plans, run, action
        self._log, self._waiting = LogThrottle(node.get_logger(), is_error=True), Waiting(node)
        self._followed = None  # of the running goal
        self._now = 0.0  # [s] simulated time that the machine has last reported
        self._states = None  # subscription, from the first goal on
        subscribe_one(node, Standing, 'machine/standing', self._on_standing, LAST_VALUE_QOS)
        self._errors = {}  # (N,) [m] of the last cycle, by joint
        self._errors_of = 0  # number of that cycle
        for joint in plans.machine.joints:
            subscribe_one(node, CycleError, f'{joint}/cycle_error', partial(self._on_errors, joint), CYCLE_QOS)
        self.server = node.serve_action(action, NAME, self._execute, self._on_cancel)

    async def _execute(self, handle):
        result = self._action.Result(error_code=self._action.Result.SUCCESSFUL)
        try:
            self._cycles.refuse_second(NAME)
            followed = self._plan(handle)
        except PkmError as error:
            self._log(f'goal refused: {error}', 'goals')
            self._fail(result, error)
            handle.abort()
            return result
        self._followed = followed
        self._states = self._states or subscribe_one(self._node, JointState, 'joint_states', self._on_state, CYCLE_QOS)
        try:
            await self._run(followed.planned, NAME, is_cancelled=lambda: handle.is_cancel_requested)
            await self._check()
            handle.succeed()
        except PkmError as error:
            self._node.get_logger().error(f'{NAME}: {error}')
            if handle.is_cancel_requested:  # as in the JointTrajectoryController, with error code 0
                result.error_string = f'cancelled: {error}'
                handle.canceled()
            else:
                self._fail(result, followed.violation or error)
                handle.abort()
        finally:
            self._followed, self._cycles.goal = None, ''
        return result

    def _plan(self, handle):
        """Return the `_Followed` of a goal; `PkmError` if it cannot be run or its tolerances not be checked."""
        request, machine = handle.request, self._plans.machine
        multi = request.multi_dof_trajectory
        for name, given in (
            ('multi_dof_trajectory', [*multi.joint_names, *multi.points]),
            ('component_path_tolerance', request.component_path_tolerance),
            ('component_goal_tolerance', request.component_goal_tolerance),
        ):
            if given:
                raise FollowError('INVALID_GOAL', f'{name}: {len(given)} entries; expected none: joints have one axis')
        path, goal = (
            [JointTolerance(each.name, each.position, each.velocity, each.acceleration) for each in given]
            for given in (request.path_tolerance, request.goal_tolerance)
        )
        tolerances = tolerances_of(machine.joints, path, goal, seconds_of(request.goal_time_tolerance))
        joints, planned = plan_command(self._plans, request.trajectory, self._cycles.standing.position, NAME)
        duration = seconds_of(request.trajectory.points[-1].time_from_start)
        check_start(seconds_of(request.trajectory.header.stamp), duration, self._now)
        silent = [each for each in tolerances.bounded if not self._node.count_publishers(f'{each}/cycle_error')]
        if silent:
            raise FollowError(
                'INVALID_GOAL', f'tolerances of {silent}: no publisher of {silent[0]}/cycle_error; expected 0 or -1'
            )
        return _Followed(handle, joints, planned, tolerances)

    async def _check(self):
        """Check the tolerances at every tick of the cycle that has ended."""
        followed, bounded = self._followed, self._followed.tolerances.bounded
        size, joints = len(followed.joints.position), followed.tolerances.joints

        def missing():
            errors = self._errors if self._errors_of == self._cycles.number else {}
            return [joint for joint in bounded if len(errors.get(joint, ())) != size]

        if not await self._waiting.until(lambda: not missing(), _ERRORS_WITHIN):
            raise FollowError(
                followed.tolerances.GOAL,
                f'tolerances: not checked, no {size} errors of {missing()} within {_ERRORS_WITHIN:g} s (cycle_error)',
            )
        errors = np.zeros((size, len(joints)))
        for joint in bounded:
            errors[:, joints.index(joint)] = self._errors[joint]
        followed.check(errors)

    def _fail(self, result, error):
        code = error.code if isinstance(error, FollowError) else 'INVALID_GOAL'
        result.error_code, result.error_string = getattr(self._action.Result, code), str(error)

    def _on_cancel(self, handle):
        if self._followed and self._followed.handle is handle:
            self._cycles.stop(f'{NAME} was cancelled')
        return CancelResponse.ACCEPT

    def _on_standing(self, message):
        self._now = 1e-9 * nanoseconds_of_standstill(message.tick, self._plans.machine.sample_time)

    def _on_errors(self, joint, message):
        if message.cycle != self._errors_of:
            self._errors_of, self._errors = message.cycle, {}
        self._errors[joint] = np.array(message.error)

    def _on_state(self, message):
        """Publish the feedback of a state during the cycle, and stop at an error outside the path tolerance."""
        followed, first = self._followed, self._cycles.first_tick
        if followed is None or first is None:
            return
        found = followed.at(message, first)
        if found is None:
            return
        time, *positions = found
        points = [
            JointTrajectoryPoint(positions=each.tolist(), time_from_start=duration_of(time)) for each in positions
        ]
        names = list(followed.tolerances.joints)
        feedback = self._action.Feedback(
            header=message.header, joint_names=names, desired=points[0], actual=points[1], error=points[2]
        )
        followed.handle.publish_feedback(feedback)
        try:
            followed.check_path(time, positions[2])
        except FollowError as violation:
            if not followed.violation:
                followed.violation = violation
                self._cycles.stop(f'{NAME}: {violation}')


class _Followed:
    """A running goal: its reference (N, n), its tolerances, and the first violation of them seen in its states."""

    def __init__(self, handle, joints, planned, tolerances):
        self.handle, self.joints, self.planned, self.tolerances = handle, joints, planned, tolerances
        self.violation = None
        self._start, self._end = int(joints.move_starts[0]), int(joints.move_ends[-1])

    def at(self, message, first_tick):
        """
        Return time [s], reference, measurement and error (n,) [m] of a JointState, None if it is not of the cycle.

        A state at standstill is of no tick.
        """
        nanoseconds, step = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, self.joints.sample_time
        tick, rest = divmod(nanoseconds, round(1e9 * step))
        measured = dict(zip(message.name, message.position, strict=False))
        sample = tick - first_tick
        if rest or not 0 <= sample < len(self.joints.position) or not measured.keys() >= set(self.tolerances.joints):
            return None
        actual = np.array([measured[joint] for joint in self.tolerances.joints])
        desired = self.joints.position[sample]
        return (sample - self._start) * step, desired, actual, desired - actual

    def check_path(self, time, error):
        """Raise `FollowError` for an `error` (n,) [m] at `time` [s] outside the path tolerance."""
        if 0 <= time < (self._end - self._start) * self.joints.sample_time:
            self.tolerances.check_path(error[None, :], [time])

    def check(self, errors):
        """Raise `FollowError` unless the `errors` (N, n) [m] of the cycle are within the tolerances."""
        self.tolerances.check_cycle(errors, self._start, self._end, self.joints.sample_time)
