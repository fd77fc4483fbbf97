"""
Node `dashboard`: the live page of a cell, see `pkm page`. It uses the public topics, services and actions only.

It subscribes to no topic of the servo tick. ROS is served `_RATE` times per second and not with every message: of pose
and joint_states, hundreds per second, only the latest message is taken. The processor is left to the cell.
"""

import os
import sys
from contextlib import closing, suppress
from math import atan2
from time import monotonic, sleep

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import ExternalShutdownException, ShutdownException, TimeoutException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.servo.cycle_run import CycleState
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleMetrics, PlatformPose, SampledTrajectory
from pkm_nodes.graph import cell_nodes, controller_nodes
from pkm_nodes.messages.diagnostics import FAULT, STATE, TICK, node_of, values_of
from pkm_nodes.page.cell import Cell, NodeLine, Notice, Status, home_pose
from pkm_nodes.parts.cycle_events import subscribe_events
from pkm_nodes.parts.machine_status import subscribe_machine_status
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.runtime.fast_path import FAST_PATH
from pkm_nodes.runtime.node import CYCLE_QOS, REFUSALS, PkmNode, RCLError, begin

# [1/s, wall] rate of serving ROS and updating the page
_RATE = 15.0
# [s, wall] without diagnostics of the machine, which come every second, until it is shown as absent
_SILENCE = 5.0
# only the latest message of a state that is published faster than `_RATE`
_LATEST_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class DashboardNode(PkmNode):
    """Keeps a `Cell` up to date and turns buttons into goals and service calls."""

    def __init__(self, **kwargs):
        super().__init__('dashboard', **kwargs)
        self.host = self.setting('host', '127.0.0.1', "address of the page; '0.0.0.0' accepts other hosts")
        self.port = self.setting('port', 8080, 'port of the page')
        self.check_settings()
        self.cell = Cell(namespace=self.get_namespace())
        self._machine_name = None  # parameter `machine` of the cell: a name of config/machines or a file
        self._expected = []  # names of its nodes
        self._single = ()  # of these, controllers of one joint
        self._of_machine = []  # subscriptions to topics of its joints
        self._diagnosed = {}  # DiagnosticStatus by node
        self._heard = -_SILENCE  # time of the machine's last diagnostics
        self._ticks = None  # (wall time, tick) of its last diagnostics
        self._asked = None  # Future of the request for the machine's name
        self._execute = ActionClient(self, ExecuteMotion, 'execute_motion')
        self._cancel = self.create_client(CancelGoal, 'execute_motion/_action/cancel_goal')
        self._reset = self.create_client(Trigger, 'machine/reset')
        self._brake = self.create_client(Trigger, 'machine/stop')
        self._machine_parameters = self.create_client(GetParameters, 'machine/get_parameters')
        subscribe_events(self, self._on_event)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        subscribe_machine_status(self, self._on_machine)
        subscribe_one(self, PoseStamped, 'pose', self._on_pose, _LATEST_QOS)
        subscribe_one(self, JointState, 'joint_states', self._on_joints, _LATEST_QOS)
        subscribe_one(self, SampledTrajectory, 'pose_trajectory', self._on_trajectory, CYCLE_QOS)
        self.create_timer(1.0, self._look_around, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def fulfil(self, wish):
        """Execute a wish: ('run', motion, cycles, law), ('visit', offsets), ('stop',), ('brake',) or ('reset',)."""
        wishes = {'run': self._run, 'visit': self._visit, 'stop': self._stop}
        wishes |= {'brake': self._brake_machine, 'reset': self._reset_machine}
        wishes[wish[0]](*wish[1:])

    # buttons

    def _run(self, motion, cycles, law):
        self._send(ExecuteMotion.Goal(motion=motion, cycles=cycles, learning_law=law), f'{motion}, law {law}')

    def _visit(self, offsets):
        home = home_pose(self.cell.machine)
        pose = PlatformPose(**{name: home[name] + offset for name, offset in offsets.items()})
        self._send(ExecuteMotion.Goal(poses=[pose], cycles=1), 'visit')

    def _send(self, goal, name):
        if not self._execute.server_is_ready():
            self._notice(f'{name}: no trajectory_generator offers execute_motion', good=False)
            return
        self._notice(f'{name}: sent')

        def on_feedback(message):
            self._notice(f'{name}: cycle {message.feedback.cycle} of {goal.cycles} done')

        def on_result(future):
            answer = future.result()
            good = answer.status in (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED)
            self._notice(f'{name}: {answer.result.message or "done"}', good=good)

        sent = self._execute.send_goal_async(goal, feedback_callback=on_feedback)
        sent.add_done_callback(lambda future: future.result().get_result_async().add_done_callback(on_result))

    def _stop(self):
        """Cancel every goal, those of other clients included: an empty request means all."""
        if not self._cancel.service_is_ready():
            self._notice('stop: no trajectory_generator offers execute_motion', good=False)
            return

        def on_answer(future):
            count = len(future.result().goals_canceling)
            self._notice(f'stop: {count} goal(s) end after this cycle' if count else 'stop: no goal is running')

        self._cancel.call_async(CancelGoal.Request()).add_done_callback(on_answer)

    def _brake_machine(self):
        self._trigger(self._brake, 'brake', 'machine/stop')

    def _reset_machine(self):
        self._trigger(self._reset, 'reset', 'machine/reset')

    def _trigger(self, client, name, service):
        """Call a service of the machine and show its answer."""
        if not client.service_is_ready():
            self._notice(f'{name}: no machine offers {service}', good=False)
            return
        answer = client.call_async(Trigger.Request())
        answer.add_done_callback(lambda f: self._notice(f'{name}: {f.result().message}', good=f.result().success))

    def _notice(self, text, *, good=True):
        self.cell.notice = Notice(text, good)

    # topics of the cell

    def _on_event(self, event):
        if self.cell.machine is not None:
            self.cell.hear(event)

    def _on_trajectory(self, message):
        machine = self.cell.machine
        if machine is not None and tuple(message.coordinates) == machine.coordinates:
            positions = np.array(message.position).reshape(-1, len(machine.coordinates))
            self.cell.load(message.cycle, message.motion, message.learning_law, positions)

    def _on_pose(self, message):
        place, turn = message.pose.position, message.pose.orientation
        seen = {'x': place.x, 'y': place.y, 'z': place.z, 'phi': 2.0 * atan2(turn.z, turn.w)}
        self.cell.pose = {name: seen[name] for name in self.cell.pose}

    def _on_joints(self, message):
        self.cell.positions = dict(zip(message.name, message.position, strict=True))

    def _on_diagnostics(self, message):
        of_nodes = {node_of(each): each for each in message.status}
        self._diagnosed |= {name: each for name, each in of_nodes.items() if name != self._name_of('machine')}

    def _on_machine(self, status):
        self._diagnosed[node_of(status)], values = status, values_of(status)
        now, tick = monotonic(), int(values.get(TICK, 0))
        if self._ticks is not None and tick < self._ticks[1]:
            self._asked = None  # it was restarted, perhaps as another machine
            self.cell.begin_anew()
        elif self._ticks is not None and now > self._ticks[0]:
            self.cell.ticks_per_second = (tick - self._ticks[1]) / (now - self._ticks[0])
        self._heard, self._ticks = now, (now, tick)
        state = values.get(STATE, '')
        if state == CycleState.FAULTED.value or status.level == DiagnosticStatus.ERROR:
            # a machine that is not of this project may have no keys
            self.cell.status, self.cell.reason = Status.FAULT, values.get(FAULT, status.message)
        else:
            running = state in [each.value for each in (CycleState.RUNNING, CycleState.HELD, CycleState.PAUSED)]
            self.cell.status, self.cell.reason = Status.RUNNING if running else Status.STANDING, ''

    # nodes of the cell

    def _look_around(self):
        """Update, once per second, whether there is a cell, its machine, and its nodes."""
        present = [name for name, space in self.get_node_names_and_namespaces() if space == self.get_namespace()]
        if 'machine' not in present or monotonic() - self._heard > _SILENCE:
            self.cell.leave()
            self._asked = None
        if self._asked is None and self._machine_parameters.service_is_ready():
            self._asked = self._machine_parameters.call_async(GetParameters.Request(names=['machine']))
            self._asked.add_done_callback(self._on_machine_name)
        self.cell.nodes = self._node_lines(present)

    def _on_machine_name(self, future):
        name = future.result().values[0].string_value
        if name == self._machine_name:
            return
        self._machine_name = name
        try:
            machine = load_machine(name)
        except PkmError as error:
            self._notice(f'machine of the cell: cannot be shown: {error}', good=False)
            return
        self.cell = Cell(machine, self.get_namespace())
        self._expected = [spec.name for spec in cell_nodes(name, record=False)]  # a cell may run without a recorder
        self._single = {spec.name for spec in controller_nodes(name, 'robust')}
        self._expected[1:1] = [*(f'linear_motor_{joint}' for joint in machine.joints), 'laser']
        while self._of_machine:
            self.destroy_subscription(self._of_machine.pop())
        for joint in machine.joints:
            topic = f'{joint}/cycle_metrics'
            self._of_machine.append(subscribe_one(self, CycleMetrics, topic, self.cell.measure, CYCLE_QOS))

    def _node_lines(self, present):
        """Return one line for every node that is present or expected."""
        torque = 'computed_torque_controller' in present  # it replaces the controllers of single joints
        expected = [name for name in self._expected if not (torque and name in self._single)]
        others = sorted({name for name in present if not name.startswith('_')} - {*expected, self.get_name()})
        lines = []
        for name in [*expected, *others]:
            status = self._diagnosed.get(self._name_of(name))
            if name not in present:
                lines.append(NodeLine(name, False, 'missing'))
            elif present.count(name) > 1:
                lines.append(NodeLine(name, False, f'{present.count(name)} of that name'))
            elif status is None:
                lines.append(NodeLine(name, True, 'up'))
            else:
                text = values_of(status).get(STATE, status.message)
                lines.append(NodeLine(name, status.level == DiagnosticStatus.OK, text))
        return lines

    def _name_of(self, node):
        return f'{self.get_namespace()}/{node}'


def serve(node, page):
    """Serve `node` and update `page` until the context is shut down."""
    executor = FAST_PATH.stepped_executor(node.context)
    executor.add_node(node)
    while node.context.ok():
        next_turn = monotonic() + 1.0 / _RATE
        for wish in page.wishes():
            node.fulfil(wish)
        _serve_ready(executor)
        page.show(node.cell)
        sleep(max(0.0, next_turn - monotonic()))


def _serve_ready(executor):
    """Serve all messages that have arrived, without waiting for more."""
    with suppress(TimeoutException, ShutdownException, ExternalShutdownException):
        while True:
            handler, _, _ = executor.wait_for_ready_callbacks(timeout_sec=0)
            handler()
            if handler.exception() is not None:
                raise handler.exception()


def show(args=None):
    """Run the node and its page until interrupted."""
    from pkm_nodes.page.page import Page

    os.nice(10)  # the page yields the processor to the cell
    begin(args)
    try:
        node = DashboardNode()
        with closing(Page(node.host, node.port)) as page:
            where = f'{node.get_namespace()}, ROS domain {node.context.get_domain_id()}'
            print(f'{page.address} shows the cell in {where}; Ctrl-C ends it', flush=True)
            serve(node, page)
        node.destroy_node()
    except Exception:
        if rclpy.ok():  # otherwise it was interrupted
            raise
    finally:
        with suppress(RCLError):  # the signal handler's thread may be faster
            rclpy.try_shutdown()


def main(args=None):
    """Run the node as a process of its own."""
    try:
        show(args)
    except REFUSALS as error:
        print(error, file=sys.stderr)
        sys.exit(1)
