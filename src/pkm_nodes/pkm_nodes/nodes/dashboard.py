"""
Node `dashboard`: the live page of a cell, see `pkm page`. It uses the public topics, services and actions only.

It subscribes to no topic of the servo tick. ROS is served `_RATE` times per second and not with every message: of pose
and joint_states, hundreds per second, only the latest message is taken. The processor is left to the cell.
"""

import os
import sys
from contextlib import closing, suppress
from math import atan2, nan
from time import monotonic

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from pkm_core.errors import PkmError
from pkm_interfaces.msg import CycleMetrics, Geometry, SampledTrajectory
from pkm_nodes.graph import cell_nodes, controller_nodes
from pkm_nodes.messages.diagnostics import FAULT, PACE_ASKED, PACE_REACHED, PAUSED, STATE, TICK, node_of, values_of
from pkm_nodes.page.cell import Cell, Notice, Pace, Status, home_pose
from pkm_nodes.page.lengths import Lengths
from pkm_nodes.page.node_table import NodeTable
from pkm_nodes.parts.cell_buttons import CellButtons
from pkm_nodes.parts.cycle_events import subscribe_events
from pkm_nodes.parts.machine_status import subscribe_machine_status
from pkm_nodes.parts.one_source import subscribe_one, subscribe_own
from pkm_nodes.runtime.node import CYCLE_QOS, REFUSALS, PkmNode, RCLError, begin
from pkm_nodes.runtime.turns import serve_in_turns

# [1/s, wall] rate of serving ROS and updating the page
_RATE = 15.0
# [s, wall] between two readings of bags: one takes up to 0.1 s, and a cell makes ten per second
_READ_EVERY = 0.3
# [s, wall] without diagnostics of the machine, which come every second, until it is shown as absent
_SILENCE = 5.0
# only the latest message of a state that is published faster than `_RATE`
_LATEST_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
# the last value of every node of a cell, not of one
_ALL_NODES_QOS = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
# states of a machine in which a cycle has begun and not ended, see pkm_core.servo.cycle_run
_RUNNING = ('running', 'held', 'paused')


class DashboardNode(PkmNode):
    """Keeps a `Cell` up to date and turns buttons into goals and service calls."""

    def __init__(self, **kwargs):
        super().__init__('dashboard', **kwargs)
        self.host = self.setting('host', '127.0.0.1', "address of the page; '0.0.0.0' accepts other hosts")
        self.port = self.setting('port', 8080, 'port of the page')
        self.check_settings()
        self.cell = self._new_cell()
        self._of_cell = None  # parameters `machine` and `session` of the cell
        self._lengths = None  # `Lengths` of its machine
        self._announced = None  # last Geometry message of its trajectory_generator
        self._table = NodeTable()
        self._of_machine = []  # subscriptions to topics of its joints
        self._reports = {}  # (whether it is well, state) by node
        self._heard = -_SILENCE  # time of the machine's last diagnostics
        self._ticks = None  # (wall time, tick) of its last diagnostics
        self._asked = None  # Future of the request for the machine's name
        self._buttons = CellButtons(self, self._notice)
        self._machine_parameters = self.create_client(GetParameters, 'machine/get_parameters')
        subscribe_events(self, self._on_event)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        subscribe_machine_status(self, self._on_machine)
        subscribe_one(self, PoseStamped, 'pose', self._on_pose, _LATEST_QOS)
        subscribe_one(self, JointState, 'joint_states', self._on_joints, _LATEST_QOS)
        subscribe_one(self, SampledTrajectory, 'pose_trajectory', self._on_trajectory, CYCLE_QOS)
        subscribe_own(self, Geometry, 'geometry', self._on_geometry, _ALL_NODES_QOS, lambda m: self._name_of(m.node))
        self.create_timer(1.0, self._look_around, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def fulfil(self, wish):
        """Execute a wish of the page: the name of a button and its arguments."""
        name, *arguments = wish
        if name == 'show':
            self.cell.chosen = arguments[0]
        elif name == 'visit':
            home = home_pose(self.cell.machine)
            self._buttons.visit({name: home[name] + offset for name, offset in arguments[0].items()})
        else:
            if name == 'run':
                self.cell.chosen = 0  # the new cycles are shown
            getattr(self._buttons, name)(*arguments)

    def _notice(self, text, *, good=True):
        self.cell.notice = Notice(text, good)

    def _new_cell(self, machine=None):
        return Cell(machine, self.get_namespace(), domain=self.context.get_domain_id())

    # topics of the cell

    def _on_event(self, event):
        if self.cell.machine is not None:
            self.cell.hear(event)

    def _on_trajectory(self, message):
        machine = self.cell.machine
        if machine is None or tuple(message.coordinates) != machine.coordinates or message.offset:
            return
        positions = np.array(message.position)
        if positions.size and not positions.size % len(machine.coordinates):
            rows = positions.reshape(-1, len(machine.coordinates))
            self.cell.load(message.cycle, message.motion, message.learning_law, rows)

    def _on_pose(self, message):
        place, turn = message.pose.position, message.pose.orientation
        seen = {'x': place.x, 'y': place.y, 'z': place.z, 'phi': 2.0 * atan2(turn.z, turn.w)}
        self.cell.pose = {name: seen[name] for name in self.cell.pose}

    def _on_joints(self, message):
        if len(message.name) == len(message.position):
            self.cell.positions = dict(zip(message.name, message.position, strict=True))

    def _on_geometry(self, message):
        if message.node == 'trajectory_generator':  # its geometry is that of the cell
            self._announced = message
            self._take_lengths()

    def _take_lengths(self):
        """Draw the machine with the lengths that the cell has announced."""
        if self._lengths is None:
            return
        if self._announced is not None:
            self._lengths.announce(self._announced.file, self._announced.geometry)
        self.cell.machine, self.cell.geometry = self._lengths.machine, self._lengths.words

    def _on_diagnostics(self, message):
        start = self._name_of('')
        for status in message.status:
            name = node_of(status).removeprefix(start)
            if name not in (node_of(status), 'machine'):
                state = values_of(status).get(STATE, status.message)
                self._reports[name] = (status.level == DiagnosticStatus.OK, state)

    def _on_machine(self, status):
        values = values_of(status)
        state = values.get(STATE, '')
        self._reports['machine'] = (status.level == DiagnosticStatus.OK, state or status.message)
        now, tick = monotonic(), _number(values.get(TICK, '0'))
        if self._ticks is not None and tick < self._ticks[1]:
            self._asked = None  # it was restarted, perhaps as another machine
            self.cell.begin_anew()
        elif self._ticks is not None and now > self._ticks[0]:
            self.cell.ticks_per_second = (tick - self._ticks[1]) / (now - self._ticks[0])
        self._heard, self._ticks = now, (now, tick)
        self.cell.pace = self._pace(values)
        if state == 'faulted' or status.level == DiagnosticStatus.ERROR:
            # a machine that is not of this project may have no keys
            self.cell.status, self.cell.reason = Status.FAULT, values.get(FAULT, status.message)
        else:
            self.cell.status, self.cell.reason = Status.RUNNING if state in _RUNNING else Status.STANDING, ''

    def _pace(self, values):
        """Return the `Pace` that the machine reports."""
        asked, reached = (_number(values.get(key, '')) for key in (PACE_ASKED, PACE_REACHED))
        offered = asked == asked and self._buttons.offers_pace
        return Pace(offered, asked, reached, values.get(PAUSED) == 'true')

    # nodes of the cell

    def _look_around(self):
        """Update, once per second, whether there is a cell, its machine, and its nodes."""
        present = [name for name, space in self.get_node_names_and_namespaces() if space == self.get_namespace()]
        if 'machine' not in present or monotonic() - self._heard > _SILENCE:
            self.cell.leave()
            self._asked = None
        if self._asked is None and self._machine_parameters.service_is_ready():
            self._ask(['machine', 'session'])
        self.cell.nodes = self._table.lines(present, self._reports, self.get_name())
        self.cell.is_replayed = 'bag_player' in present

    def _ask(self, names):
        """Ask the machine for parameters of the cell."""
        self._asked = self._machine_parameters.call_async(GetParameters.Request(names=names))
        self._asked.add_done_callback(lambda future: self._on_parameters(future, names))

    def _on_parameters(self, future, names):
        of_cell = [value.string_value for value in future.result().values]
        if not of_cell and len(names) > 1:
            self._ask(names[:1])  # a machine of the user's own may have no session
        if not of_cell or of_cell == self._of_cell:
            return
        self._of_cell, self._lengths, name = of_cell, None, of_cell[0]
        try:
            self._lengths = Lengths(name)
        except PkmError as error:
            self._notice(f'machine of the cell: cannot be shown: {error}', good=False)
            return
        machine = self._lengths.machine
        self.cell = self._new_cell(machine)
        self._take_lengths()
        expected = [spec.name for spec in cell_nodes(name, record=False)]  # a cell may run without a recorder
        expected[1:1] = [*(f'linear_motor_{joint}' for joint in machine.joints), 'laser']
        self._table = NodeTable(expected, {spec.name for spec in controller_nodes(name, 'robust')})
        while self._of_machine:
            self.destroy_subscription(self._of_machine.pop())
        for joint in machine.joints:
            topic = f'{joint}/cycle_metrics'
            self._of_machine.append(subscribe_one(self, CycleMetrics, topic, self._on_metrics, CYCLE_QOS))

    def _on_metrics(self, message):
        if message.joint in self.cell.machine.joints:
            self.cell.measure(message)

    def _name_of(self, node):
        return f'{self.get_namespace().rstrip("/")}/{node}'


def _number(text):
    """Return `text` as a number, nan if it is none."""
    try:
        return float(text)
    except ValueError:
        return nan


def serve(node, page):
    """Serve `node` and update `page` until the context is shut down."""
    read_at = 0.0

    def fulfil():
        for wish in page.wishes():
            node.fulfil(wish)

    def show_cell():
        nonlocal read_at
        if monotonic() >= read_at:
            node.cell.refresh()
            read_at = monotonic() + _READ_EVERY
        page.show(node.cell)

    serve_in_turns(node, _RATE, fulfil, show_cell)


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
