"""
Node `trajectory_generator`: commands in, one pose_trajectory per cycle out.

A command is a goal of execute_motion, go_to or home, a joint_trajectory_command, or a stream on jog; where package
control_msgs is installed, also a goal of follow_joint_trajectory. It is run cycle by cycle: publish the trajectory,
wait until the machine has run it, begin the next cycle. The trajectory is resent every second until the machine starts
the cycle, so the nodes may start in any order. When the process of the machine disappears during a cycle, the cycle
ends with a STOP event. An experiment of identification is planned in joints: its joint_trajectory and excitation are
published with its pose_trajectory.

The node serves the actions. `GoalPlans` plans, `GoalCycles` publishes and follows the cycles.
"""

from math import nan

from rclpy.action import CancelResponse

from pkm_core.errors import PkmError
from pkm_core.machines.geometry import load_geometry
from pkm_core.servo.goal_cycle import GoalCycle
from pkm_interfaces.action import ExecuteMotion, GoTo, Home
from pkm_interfaces.msg import PlatformPose
from pkm_nodes.parts.cell_geometry import CellGeometry
from pkm_nodes.parts.follow_joint_trajectory import FollowJointTrajectory, find_action
from pkm_nodes.parts.goal_cycles import GoalCycles
from pkm_nodes.parts.goal_plans import GoalPlans
from pkm_nodes.parts.jog import Jog
from pkm_nodes.parts.joint_commands import JointCommands
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CALIBRATED, PkmNode, entry_point
from pkm_nodes.runtime.session import require_session


class TrajectoryGeneratorNode(PkmNode):
    """Action servers of the cell: one goal at a time, its cycles one after the other."""

    def __init__(self, **kwargs):
        super().__init__('trajectory_generator', **kwargs)
        geometry = load_geometry(self.machine_setting(), self.configuration_setting())
        chosen = self.control_setting()
        calibrated = self.setting('calibrated', 'calibrated', CALIBRATED)
        start_timeout = self.setting('start_timeout', 30.0, '[s, wall] from a trajectory to the first tick')
        metrics_timeout = self.setting('metrics_timeout', 2.0, '[s, wall] from the last tick to the metrics')
        silence = self.setting(
            'machine_timeout', 12.0, '[s, wall] without diagnostics of the machine until it is stuck'
        )
        self.check_settings()
        self._log_refusal = LogThrottle(self.get_logger(), is_error=True)
        self._geometry = NodeGeometry(self, geometry)
        self._cycles = GoalCycles(self, geometry.machine, GoalCycle(start_timeout, metrics_timeout, silence))
        self._plans = GoalPlans(self, self._geometry, chosen, self._cycles.standing)
        self._cell_geometry = CellGeometry(
            self, self._geometry, calibrated, self._cycles.occupy, self._cycles.publish_notice
        )
        commands = JointCommands(self, self._cycles, self._plans, self._run_command)
        self._jog = Jog(self, self._cycles, self._plans, commands, self._run_command)
        self.offer('trajectory_generator/reload', self._plans.reload)
        served = (
            (ExecuteMotion, 'execute_motion', self._execute),
            (GoTo, 'go_to', self._go),
            (Home, 'home', self._home),
        )
        self._servers = [self.serve_action(*each, lambda _: CancelResponse.ACCEPT) for each in served]
        follow = find_action()
        if follow:
            followed = FollowJointTrajectory(self, self._cycles, self._plans, self._run_cycle, follow)
            self._servers.append(followed.server)

    async def _execute(self, goal_handle):
        """Run a goal of execute_motion."""
        request, result = goal_handle.request, ExecuteMotion.Result()

        def on_cycle(number, errors):
            result.cycles_completed = number
            joints = self._geometry.machine.joints
            goal_handle.publish_feedback(
                ExecuteMotion.Feedback(
                    session=self.session,
                    cycle=number,
                    joints=list(joints),
                    max_dynamic_error=[errors.get(joint, nan) for joint in joints],
                )
            )

        name = request.motion or request.experiment.motion or 'poses'
        await self._serve(goal_handle, result, name, self._plans.of_motion, request.cycles, on_cycle)
        return result

    async def _go(self, goal_handle):
        """Run a goal of go_to."""
        result = GoTo.Result()

        def on_cycle(*_):
            result.cycle = self._cycles.number

        await self._serve(goal_handle, result, 'go_to', self._plans.to_pose, 1, on_cycle)
        machine = self._geometry.machine
        pose = machine.forward(self._cycles.standing.position).tolist()
        result.pose = PlatformPose(**dict(zip(machine.coordinates, pose, strict=True)))
        return result

    async def _home(self, goal_handle):
        """Run a goal of home; nothing moves if the machine stands there."""
        result = Home.Result()

        def on_cycle(*_):
            result.cycle = self._cycles.number

        if self._cycles.standing.is_at_home and not self._cycles.goal:
            result.session, result.message = self.session, 'the machine stands at home'
            goal_handle.succeed()
            return result
        await self._serve(goal_handle, result, 'home', self._plans.to_home, 1, on_cycle)
        return result

    async def _serve(self, goal_handle, result, name, plan, cycles, on_cycle):
        """
        Run one goal and end it. A refused goal is accepted and aborted, because only a result carries the reason.

        `plan(request)` returns its `PlannedGoal`; `on_cycle(number, errors)` is called after each of its `cycles`.
        """
        result.session = self.session
        try:
            require_session('goal', goal_handle.request.session, self.session)
            self._cycles.refuse_second(name)
            planned = plan(goal_handle.request)
        except PkmError as error:
            self._log_refusal(f'goal refused: {error}', 'goals')
            result.message = str(error)
            goal_handle.abort()
            return
        try:
            for number in range(1, cycles + 1):
                end = await self._run_cycle(planned, f'motion {planned.name!r}, cycle {number} of {cycles}', number > 1)
                on_cycle(number, end.errors)
                if goal_handle.is_cancel_requested and number < cycles:
                    result.message = f'cancelled after cycle {number} of {cycles}; the machine stands at home'
                    goal_handle.canceled()
                    return
            goal_handle.succeed()
        except PkmError as error:
            result.message = str(error)
            self.get_logger().error(f'{self._cycles.goal}: {error}')
            goal_handle.abort()
        finally:
            self._cycles.goal = ''

    async def _run_cycle(self, planned, goal, later=False, is_cancelled=lambda: False):
        """Run one cycle and return its `End`; `PkmError` if it was not run, or a node keeps another geometry."""
        self._cycles.goal = goal
        await self._cell_geometry.align()
        if is_cancelled():
            raise PkmError('cancelled before the cycle was sent; nothing has moved')
        end = await self._cycles.run(planned, goal, later)
        if end.reason:
            raise PkmError(end.reason)
        return end

    async def _run_command(self, planned):
        """Run the cycle of a command by topic."""
        try:
            await self._run_cycle(planned, self._cycles.goal)
        finally:
            self._cycles.goal = ''

    def destroy_node(self):
        """Destroy the action servers first; `Node` does not destroy them."""
        for server in self._servers:
            server.destroy()
        super().destroy_node()


main = entry_point(TrajectoryGeneratorNode)
