"""The cycles of a controller between ticks: load the trajectory, report it, publish errors and metrics afterwards."""

from array import array
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import monotonic

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.metrics import axis_metrics
from pkm_core.motion.pieces import checked_piece
from pkm_core.motion.trajectory import SampledTrajectory
from pkm_core.servo.controller_cycle import Action, ControllerCycle, ControllerState
from pkm_interfaces.msg import CycleError, CycleEvent, CycleMetrics, EncoderSample, MotorCommand
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_nodes.messages.conversions import feedforward_from_msg, trajectory_from_msg
from pkm_nodes.messages.diagnostics import CYCLE, FOREIGN, NOTICE, OTHERS, REFUSED, STATE, diagnostics
from pkm_nodes.parts.cycle_events import subscribe_events
from pkm_nodes.parts.encoder_crowd import EncoderCrowd
from pkm_nodes.parts.follow_standing import follow_standing
from pkm_nodes.parts.one_source import subscribe_joint_trajectory
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CYCLE_QOS, LAST_VALUE_QOS

# [s, wall] wait for readers of the commands that are known but not connected, such as a recorder that starts up
DISCOVERY = 2.0
# [s, wall] period of the attempts to load a waiting cycle
_RETRY = 0.05
# text of the diagnostics, for people
_TEXTS = {
    ControllerState.STANDING: 'standing',
    ControllerState.WAITING: 'cycle waiting',
    ControllerState.LOADED: 'cycle loaded',
    ControllerState.RUNNING: 'cycle running',
}


def following_error_limit(node):
    """Declare the parameter `following_error_limit` of `node` and return its value [m]."""
    # chosen: 40 times the error without learning in the hard environment, and far from every stop
    return node.setting('following_error_limit', 1e-3, '[m] an axis further from its reference stops the machine')


def choose_gains(node, *kinds):
    """
    Declare the parameters `machine` and `control` of `node`.

    Parameters
    ----------
    node : PkmNode
        A controller under construction.
    *kinds : str
        Kinds of control that the node runs, see `kind_of`; the first one is the default.

    Returns
    -------
    machine : Machine
    chosen : str
        Value of `control`.
    gains : dict
        Gains by joint.

    Raises
    ------
    ConfigError
        If `control` is of another kind.

    """
    machine = load_machine(node.machine_setting())
    own = ' or '.join(f"'{kind}'" for kind in kinds)
    chosen = node.setting('control', kinds[0], f"{own} for the machine's own, a file of config, or a YAML file")
    gains = choose_control(machine, chosen)
    if kind_of(gains) not in kinds:
        raise ConfigError(
            f'{node.get_name()}: control {chosen!r} is for {kind_of(gains)}; this node is for {" or ".join(kinds)}'
        )
    return machine, chosen, gains


@dataclass(frozen=True, eq=False)
class LoadedCycle:
    """A cycle with its trajectory in joints."""

    message: SampledTrajectoryMessage  # joint_trajectory
    trajectory: SampledTrajectory
    feedforward: np.ndarray | None  # (N, joints of the machine) [V] that the cycle brings along
    errors: np.ndarray  # (N, joints of the controller) [m], written on the tick path


def _nothing(*_):
    """Do nothing."""


@dataclass(frozen=True)
class CycleLaw:
    """
    The law of a controller, as functions that `CycleController` calls between ticks.

    Attributes
    ----------
    load : callable
        `load(LoadedCycle)`; `PkmError` if the law cannot drive it.
    reset : callable
        `reset()`: forget the state of the law. The machine stands, at home or after a safe stop.
    check : callable
        `check(message)`; `PkmError` if the law cannot drive the cycle of this joint_trajectory.
    extend : callable
        `extend(LoadedCycle, offset)`: check a piece of a jog, which begins at sample `offset` of the extended cycle;
        return the function that puts it in force before the tick of this sample; `PkmError` if the law cannot drive it.
    is_busy : callable
        `is_busy(message)`: whether the cycle of this joint_trajectory has to wait.
    learn : callable
        `learn(LoadedCycle)` after the last tick.
    notice : callable
        `notice()`: warning for the diagnostics, '' if there is none.

    """

    load: Callable
    reset: Callable
    extend: Callable
    check: Callable = _nothing
    is_busy: Callable = field(default=lambda _: False)
    learn: Callable = _nothing
    notice: Callable = field(default=lambda: '')


class CycleController:
    """
    The cycles of one or more joints; a node owns it and answers the ticks.

    A cycle is reported as LOADED when trajectory and learned feedforward are in place. While it runs, only its end, a
    safe stop, a STOP event or a reset of the machine changes what is loaded.

    Parameters
    ----------
    node : PkmNode
    machine : Machine
    events : dict of str to CycleEvents
        By joint of this controller, in the order of the columns of `LoadedCycle.errors`.
    law : CycleLaw
    following_limit : float
        [m] of `following_error_limit`; the owner of the tick path compares, and calls `stop`.

    Attributes
    ----------
    cycle : ControllerCycle
        For the tick path: `active` and `running`.
    senders : tuple of callable
        One per joint; publishes the bytes of a MotorCommand.

    """

    def __init__(self, node, machine, events, law, following_limit):
        self._following_limit = following_limit
        self._node, self._machine, self._events, self._law = node, machine, events, law
        self.cycle = ControllerCycle(DISCOVERY)
        self._loaded = None  # LoadedCycle, the last one
        # (LoadedCycle, function that puts it in force): the next pieces of a jog, two if one overtakes its first tick
        self._next = deque()
        publishers = [node.tick_publisher(MotorCommand, f'{joint}/command') for joint in events]
        self._commands, self.senders = zip(*publishers, strict=True)
        self._metrics = [node.create_publisher(CycleMetrics, f'{joint}/cycle_metrics', CYCLE_QOS) for joint in events]
        self._error = [node.create_publisher(CycleError, f'{joint}/cycle_error', CYCLE_QOS) for joint in events]
        used = CycleEvent.ANNOUNCED, CycleEvent.STOP, CycleEvent.RESET
        # first: a reset must be served before the trajectory that follows it
        subscribe_events(node, self._on_event, kinds=used)
        subscribe_joint_trajectory(node, self._on_trajectory)
        self._standing = follow_standing(node, machine)
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._retry = node.create_timer(_RETRY, self.load_if_possible, clock=wall)
        self._retry.cancel()
        self._crowd = EncoderCrowd(node)
        self._announced = None  # number of the cycle of the goal, None before the first one
        self._log_refusal = LogThrottle(node.get_logger(), is_error=True)
        self._foreign_before = 0  # messages of other publishers before the loaded cycle
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', LAST_VALUE_QOS)
        node.create_timer(1.0, self._publish_diagnostics, clock=wall)

    def extended(self, mode, index):
        """
        Take the `mode`, not RUN, of sample `index`: use the next piece of a jog, or drop the cycle at a safe stop.

        Return whether the tick needs an answer.
        """
        if mode != EncoderSample.EXTENDED:
            self.drop()
            return False
        if self._next and self._next[0][0].message.offset == index:  # else in force: a further joint of the tick
            self._loaded, put_in_force = self._next.popleft()
            put_in_force()
        return True

    def drop(self):
        """Drop the loaded cycle; the law starts the next one as after power-up."""
        self.cycle.end()
        self._next.clear()
        self._law.reset()

    def finish(self):
        """End the running cycle after its last tick: publish the metrics, then learn."""
        self.cycle.end()
        if self._node.foreign_messages() > self._foreign_before and (others := self._crowd.others()):
            for events in self._events.values():
                events.publish(CycleEvent.NOTICE, self.cycle.last, message=others)
        loaded = self._loaded
        self._standing.ended(self.cycle.last, loaded.trajectory.position[-1])
        moves = loaded.trajectory.move_starts, loaded.trajectory.move_ends
        for joint, error, whole in zip(self._events, loaded.errors.T, self._error, strict=True):
            whole.publish(CycleError(cycle=loaded.message.cycle, joint=joint, error=array('d', error.tobytes())))
        for joint, error, publisher in zip(self._events, loaded.errors.T, self._metrics, strict=True):
            metrics = axis_metrics(error, *moves, self._machine.sample_time)
            publisher.publish(
                CycleMetrics(
                    cycle=loaded.message.cycle,
                    joint=joint,
                    max_dynamic_error=metrics.max_dynamic_error,
                    settling_time_5um=metrics.settling_time_5um,
                    settling_time_1um=metrics.settling_time_1um,
                    steady_state_error=metrics.steady_state_error,
                )
            )
        self._law.learn(loaded)

    def stop(self, tick, joint, error):
        """Request a stop: `error` [m] of `joint` at `tick` exceeds the limit; the tick gets no command."""
        self._events[joint].publish(
            CycleEvent.STOP,
            self.cycle.active,
            tick=tick,
            message=f'{joint}: following error is {1e3 * error:.3f} mm; '
            f'allowed: at most {1e3 * self._following_limit:g} mm (parameter following_error_limit)',
        )

    def load_if_possible(self):
        """Load the waiting cycle if the law is free and the readers of the commands are connected."""
        waiting = self.cycle.waiting
        if waiting is None or self._law.is_busy(waiting.message) or not all(map(self._is_connected, self._commands)):
            return
        crowd = self._crowd.find()
        if crowd and not self._crowd.stays():
            return
        self._retry.cancel()
        self._loaded = self.cycle.begin()
        self._next.clear()
        if crowd:
            self._refuse(self.cycle.last, f'cycle {self.cycle.last}: {crowd}')
            return
        self._foreign_before = self._node.foreign_messages()
        try:
            self._law.load(self._loaded)
        except PkmError as error:
            self._refuse(self.cycle.last, error)
            return
        self.cycle.loaded()
        self._report_loaded()

    def _on_event(self, event):
        if event.event == CycleEvent.ANNOUNCED:
            self._announced = event.cycle
        stopped = event.event == CycleEvent.STOP and self.cycle.is_stopped_by(event.cycle)
        if event.event == CycleEvent.RESET:
            self._standing.reset()
        if stopped or event.event == CycleEvent.RESET:
            self.drop()

    def _on_trajectory(self, message):
        """Take the trajectory of the next cycle, or a piece of it; report the loaded one again if it is that."""
        if message.offset:
            self._on_piece(message)
            return
        action = self.cycle.on_trajectory(message.cycle)
        if action is Action.REPORT:
            if self.cycle.running or not self._crowd.find():
                self._report_loaded()
            return
        machine = self._machine
        try:
            if action is Action.REFUSE:
                raise PkmError(
                    f'trajectory of cycle {message.cycle}: cycle {self.cycle.active} is running; wait for its end, '
                    f'or call machine/reset if it has none'
                )
            trajectory = trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)
            self._standing.check(trajectory, stay=message.stay)  # also what a trajectory source of the user sends
            feedforward = feedforward_from_msg(message, trajectory.position.shape)
            self._law.check(message)
        except PkmError as error:
            self._refuse(message.cycle, error)
            return
        errors = np.zeros((len(trajectory), len(self._events)))
        self.cycle.wait_for(message.cycle, LoadedCycle(message, trajectory, feedforward, errors), monotonic())
        self._retry.reset()
        self.load_if_possible()

    def _on_piece(self, message):
        """Take the next piece of the running jog; a refused one ends the jog at rest."""
        loaded, machine = self._next[-1][0] if self._next else self._loaded, self._machine
        if message.cycle != self.cycle.active or message.offset != loaded.message.hold:
            return
        try:
            piece = trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)
            whole = checked_piece(machine, loaded.trajectory, message.offset, piece)
            errors = np.zeros((len(whole), len(self._events)))
            extended = replace(loaded, message=message, trajectory=whole, errors=errors)
            put_in_force = self._law.extend(extended, message.offset)
        except PkmError as error:
            self._log_refusal(f'piece of a jog refused: {error}')
            for events in self._events.values():
                events.publish(CycleEvent.NOTICE, message.cycle, message=f'jog: {error}')
            return

        def put():
            errors[: message.offset] = loaded.errors[: message.offset]
            put_in_force()

        self._next.append((extended, put))
        for events in self._events.values():
            events.publish(CycleEvent.LOADED, message.cycle, samples=len(whole), hold=message.hold)

    def _refuse(self, cycle, error):
        self._log_refusal(f'joint_trajectory refused: {error}')
        if self._announced not in (None, cycle):  # foreign: the event would end the goal that runs or comes
            return
        for events in self._events.values():
            events.publish(CycleEvent.REFUSED, cycle, message=str(error))

    def _is_connected(self, publisher):
        known = self._node.count_subscribers(publisher.topic_name)
        return self.cycle.is_connected(known, publisher.get_subscription_count(), monotonic())

    def _report_loaded(self):
        for events in self._events.values():
            loaded = self._loaded
            samples, hold = len(loaded.trajectory), loaded.message.hold
            events.publish(CycleEvent.LOADED, self.cycle.active, samples=samples, hold=hold)

    def _publish_diagnostics(self):
        notice, state, others = self._law.notice(), self.cycle.state, self._crowd.others()
        refused, foreign = self._node.refused_messages(), self._node.foreign_messages()
        level = DiagnosticStatus.WARN if notice or refused or others else DiagnosticStatus.OK
        values = {STATE: state, CYCLE: self.cycle.last, NOTICE: notice, REFUSED: refused}
        values |= {FOREIGN: foreign, OTHERS: others}
        stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostics(self._node, level, others or notice or _TEXTS[state], values, stamp))
