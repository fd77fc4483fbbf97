"""A client of the cell for scripts: waits for it, runs a motion, and logs its cycles."""

from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from time import monotonic

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import UInt64

from pkm_core.errors import PkmError
from pkm_core.interrupts import held_back
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleEvent
from pkm_interfaces.srv import SaveLearned
from pkm_nodes.clients.machine_watch import MachineWatch
from pkm_nodes.clients.replacements import Substitutes
from pkm_nodes.graph import NAMESPACE
from pkm_nodes.parts.cycle_events import subscribe_events
from pkm_nodes.parts.presence import Presence
from pkm_nodes.runtime.fast_path import FAST_PATH
from pkm_nodes.runtime.node import TICK_QOS, PkmNode
from pkm_nodes.runtime.one_publisher import node_name

# [s, wall] ten processes on a busy two-core computer started in 20 s; the rest is margin
_UP_TIMEOUT = 90.0
# [s, wall] for the name of a server: a server of another user never gets one, and refuses a goal of this session
_NAMED = 45.0
# [s, wall] for the names of further servers: the name of a node arrives later than its servers
_NAMED_TOO = 5.0
# [s, wall] before missing replacements of nodes are reported
_PATIENCE = 5.0
# [s, wall] for the answer to a request: DDS forgets a killed process after 20 s at most
ANSWER_TIMEOUT = 23.0
# [s, wall] from the end of a process, or 8 s after its stop, to the end of the goal: 25 s with margin
_AFTER_DEATH = 15.0
# [s, wall] from the last tick to the closed bag
_RECORDED_TIMEOUT = 10.0
# [s, wall] from the last tick to the diagnostics of the machine, sent every second, and to the bag of a cut cycle
_REPORTED = 3.0


@dataclass
class CycleLog:
    """Events of the machine and the recorder in the cycles of one motion."""

    ticks: int = 0
    seconds_in_cycles: float = 0.0  # [s, wall] between first and last tick, summed over the cycles
    seconds: float = 0.0  # [s, wall] from the first tick of the first to the last tick of the last cycle
    bags: list[Path] = field(default_factory=list)
    unrecorded: list[str] = field(default_factory=list)  # reasons why cycles have no bag
    notices: list[str] = field(default_factory=list)  # changes that the cell made by itself, with the cycle


class CellClient:
    """
    Client of the running cell in `namespace`; use it in a ``with`` block. It owns rclpy's default context.

    With a `session` its goals and requests are for that start of the cell only, and it ignores the events of others.
    `machine` is a `MachineWatch`.
    """

    def __init__(self, namespace=NAMESPACE, session=''):
        self._namespace, self._session = namespace, session

    def __enter__(self):
        with held_back():
            self._open()
        return self

    def _open(self):
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # a signal raises `Interrupted`; the graph stays
        of_session = [Parameter('session', value=self._session)]
        self._node = PkmNode('pkm_run', namespace=self._namespace, parameter_overrides=of_session)
        self._executor = FAST_PATH.stepped_executor(rclpy.get_default_context())
        self._executor.add_node(self._node)
        self._client = ActionClient(self._node, ExecuteMotion, 'execute_motion')
        self._begin_log()
        ends = CycleEvent.FINISHED, CycleEvent.FAULT, CycleEvent.RECORDED, CycleEvent.NOT_RECORDED
        subscribe_events(self._node, self._on_event, kinds=(CycleEvent.STARTED, CycleEvent.NOTICE, *ends))
        self.machine = MachineWatch(self._node)

    def __exit__(self, *_):
        with held_back():
            self._client.destroy()
            self._node.destroy_node()
            rclpy.try_shutdown()

    def _begin_log(self):
        self._log, self._of_goal = CycleLog(), set()  # the log and the numbers of its cycles
        self._started = self._first = None

    def _on_event(self, event):
        now = monotonic()
        if event.event == CycleEvent.STARTED:
            self._started, self._started_tick = now, event.tick
            self._of_goal.add(event.cycle)
            self._first = self._first or now
        elif event.event in (CycleEvent.FINISHED, CycleEvent.FAULT) and self._started is not None:
            self._log.ticks += event.tick - self._started_tick
            self._log.seconds_in_cycles += now - self._started
            self._log.seconds = now - self._first
            self._started = None
        elif event.event == CycleEvent.RECORDED and event.cycle in self._of_goal:
            self._log.bags.append(Path(event.bag))
        elif event.event == CycleEvent.NOT_RECORDED and event.cycle in self._of_goal:
            self._log.unrecorded.append(f'cycle {event.cycle} is not recorded: {event.message}')
        elif event.event == CycleEvent.NOTICE:
            self._notice(event)

    @property
    def log(self):
        """The `CycleLog` of the last motion, also of one that has ended early."""
        return self._log

    def _notice(self, event):
        """Take a notice of the running, the last or the next cycle of the goal: every process can send one of any."""
        last = max(self._of_goal, default=None)
        text = f'cycle {event.cycle}: {event.message}'
        if (last is None or event.cycle in (*self._of_goal, last + 1)) and text not in self._log.notices:
            self._log.notices.append(text)

    def _spin_until(self, condition, check, timeout, what):
        """Serve ROS until `condition()`; `PkmError` from `check()`, or with `what` after `timeout` [s]."""
        if not self._comes_true(condition, check, timeout):
            raise PkmError(f'{what} within {timeout:.0f} s')

    def _comes_true(self, condition, check, timeout):
        """Serve ROS until `condition()`, at most `timeout` [s]; return whether it became true."""
        deadline = monotonic() + timeout
        while not condition():
            with held_back():  # an exception within rclpy can leave it without answers
                self._executor.spin_once(timeout_sec=0.1)
            check()
            if monotonic() > deadline:
                return False
        return True

    def wait_until_up(self, check):
        """Wait for the cell's action server; `PkmError` if the namespace has a second cell."""
        offered = self._client.server_is_ready
        self._spin_until(offered, check, _UP_TIMEOUT, 'the cell did not offer execute_motion')
        self._comes_true(lambda: any(self._servers()), check, _NAMED)
        if len(self._servers()) > 1:
            self._comes_true(lambda: all(self._servers()), check, _NAMED_TOO)
        self._refuse_several()
        namespace = self._node.get_namespace()
        machines = self._node.get_node_names_and_namespaces().count(('machine', namespace))
        if machines > 1:
            raise PkmError(
                f'{namespace}: {machines} machines run; expected 1. Stop the other cell, or set another namespace'
            )

    def _servers(self):
        """Return the nodes that offer execute_motion; DDS returns no names of nodes of another user."""
        infos = self._node.get_publishers_info_by_topic('execute_motion/_action/status')
        return ['' if info.node_name.startswith('_') else node_name(info) for info in infos]

    def _refuse_several(self):
        """Raise `PkmError` if several nodes offer execute_motion: each would get the goal, and one would answer it."""
        servers = self._servers()
        if len(servers) > 1:
            names = [name or 'one without a name, of another user of this computer' for name in sorted(servers)]
            raise PkmError(
                f'{self._node.get_namespace()}: {len(servers)} nodes offer execute_motion, {", ".join(names)}; '
                f'allowed: 1. Stop the other cell, or set another ROS_DOMAIN_ID or namespace'
            )

    def wait_for_others(self, cell, tell):
        """
        Wait for the replacements of the nodes that `cell`, a `CellProcesses`, leaves out.

        After a few seconds `tell(text)` is called once with the missing ones. A foreign machine need not wait for the
        recorder; this method does in that case.

        Returns
        -------
        check : callable
            To use instead of `cell.check`: it also raises when a replacement has left.

        Raises
        ------
        PkmError
            If a replacement is missing after the timeout, or a process of the cell has ended.

        """
        substitutes = Substitutes(self._node, cell)

        def complete():
            return not substitutes.missing()

        if not self._comes_true(complete, cell.check, _PATIENCE):
            tell(substitutes.describe_missing())
            if not self._comes_true(complete, cell.check, _UP_TIMEOUT):
                raise PkmError(f'{substitutes.describe_missing()}\nno replacement within {_UP_TIMEOUT:.0f} s')
        running = [spec.name for spec in cell.nodes]
        if 'recorder' in running and 'machine' not in running:
            ready = []
            subscription = self._node.create_subscription(UInt64, 'recorder/tick', ready.append, TICK_QOS)
            late = 'the recorder did not find every encoder and command'
            self._spin_until(lambda: ready, cell.check, _UP_TIMEOUT, late)
            self._node.destroy_subscription(subscription)
        return substitutes.check

    def execute(self, motion, cycles, law, check, on_feedback, *, learned='', record=True):
        """
        Run `motion` and return the `CycleLog`, with `record` after the last bag is closed.

        A cycle that cannot be recorded ends the goal. `learned` names a file with the feedforward of the first cycle.

        Raises
        ------
        PkmError
            If the goal ends early; with the cell's own message.

        """
        goal = ExecuteMotion.Goal(
            session=self._session, motion=str(motion), cycles=cycles, learning_law=law, learned=str(learned)
        )
        self._begin_log()
        self._spin_until(self._client.server_is_ready, check, _UP_TIMEOUT, 'the cell did not offer execute_motion')
        handle = self._send(self._client, goal, 'execute_motion', check, on_feedback)
        try:
            answer = self._wait_for_result(handle, 'execute_motion', check, lambda: bool(self._log.unrecorded))
        except PkmError:
            self._await_last_bag(record)
            raise
        if self._log.unrecorded or answer.status != GoalStatus.STATUS_SUCCEEDED:
            self._await_last_bag(record)
            reason = next(iter(self._log.unrecorded), answer.result.message)
            raise PkmError(f'after {answer.result.cycles_completed} of {cycles} cycles: {reason}')
        self._spin_until(
            lambda: not record or self._log.unrecorded or len(self._log.bags) >= cycles,
            check,
            _RECORDED_TIMEOUT,
            f'the recorder has not closed all {cycles} bags',
        )
        if self._log.unrecorded:
            raise PkmError(self._log.unrecorded[0])
        return self._log

    def _await_last_bag(self, record):
        """Wait for the bag of the cycle that has ended early: the caller may end the cell at once."""
        if record:
            ends = self._log.bags, self._log.unrecorded
            self._comes_true(lambda: sum(map(len, ends)) >= len(self._of_goal), lambda: None, _REPORTED)

    def pace_figures(self, check):
        """Return the figures of the machine's pace after the last cycle; None where it reports none."""
        self._comes_true(lambda: self.machine.has_ended(max(self._of_goal)), check, _REPORTED)
        return self.machine.figures()

    def _send(self, client, goal, action, check, on_feedback):
        """Return the handle of `goal`, sent with `client` to `action`; `PkmError` if its server leaves unanswered."""
        server = Presence(self._node, f'{action}/_action/status')
        sent = client.send_goal_async(goal, feedback_callback=lambda message: on_feedback(message.feedback))
        late = f'the cell did not answer a goal of {action}'
        self._spin_until(lambda: sent.done() or server.has_ended(), check, ANSWER_TIMEOUT, late)
        if not sent.done():
            raise PkmError(f'{action}: its server {server.names()} was killed, or is stopped: no answer; restart it')
        return sent.result()

    def _wait_for_result(self, goal, action, check, is_enough=lambda: False):
        """
        Return the result response of a `goal` handle of `action`; the goal is cancelled when `is_enough()`.

        Raises
        ------
        PkmError
            If a process has ended, see `check`, or the action server has left: its goal would never end.

        """
        answer, server = goal.get_result_async(), Presence(self._node, f'{action}/_action/status')

        def over():
            return answer.done() or server.has_ended()

        try:
            self._spin_until(lambda: over() or is_enough(), check, inf, '')
            if not over():
                goal.cancel_goal_async()
                self._spin_until(over, check, inf, '')
        except PkmError as death:
            # a machine without the replies of an ended process makes a safe stop and reports it; if the cycle does not
            # need that process, the goal ends after the cycle
            goal.cancel_goal_async()
            self._spin_until(over, lambda: None, _AFTER_DEATH, f'{death}\nthe goal did not end')
            raise PkmError(f'{death}\n{answer.result().result.message if answer.done() else ""}'.rstrip()) from None
        if not answer.done():
            raise PkmError(f'{action}: its server {server.names()} was killed, or is stopped; the goal is lost')
        return answer.result()

    def save_learned(self, path, check):
        """Make the cell save the best feedforward of the last motion to `path`; `PkmError` if it refuses."""
        client = self._node.create_client(SaveLearned, 'learning/save')
        answer = client.call_async(SaveLearned.Request(session=self._session, path=str(path)))
        self._spin_until(answer.done, check, ANSWER_TIMEOUT, f'{client.srv_name} did not answer')
        self._node.destroy_client(client)
        if not answer.result().success:
            raise PkmError(answer.result().message)
