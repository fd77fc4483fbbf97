"""The cycles of a controller between ticks: load the trajectory, report it, publish errors and metrics afterwards."""

from array import array
from time import monotonic

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.metrics import axis_metrics
from pkm_core.servo.controller_cycle import Action, ControllerCycle, ControllerState
from pkm_interfaces.msg import CycleError, CycleEvent, CycleMetrics, EncoderSample, MotorCommand
from pkm_nodes.messages.conversions import feedforward_from_msg, trajectory_from_msg
from pkm_nodes.messages.diagnostics import CYCLE, FOREIGN, NOTICE, OTHERS, REFUSED, STATE, diagnostics
from pkm_nodes.parts.cycle_events import subscribe_events
from pkm_nodes.parts.cycle_law import LoadedCycle
from pkm_nodes.parts.cycle_pieces import CyclePieces
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
        publishers = [node.tick_publisher(MotorCommand, f'{joint}/command') for joint in events]
        self._commands, self.senders = zip(*publishers, strict=True)
        self._metrics = [node.create_publisher(CycleMetrics, f'{joint}/cycle_metrics', CYCLE_QOS) for joint in events]
        self._error = [node.create_publisher(CycleError, f'{joint}/cycle_error', CYCLE_QOS) for joint in events]
        used = CycleEvent.ANNOUNCED, CycleEvent.STOP, CycleEvent.RESET
        # first: a reset must be served before the trajectory that follows it
        subscribe_events(node, self._on_event, kinds=used)
        self._source = subscribe_joint_trajectory(node, self._on_trajectory)
        self._standing = follow_standing(node, machine)
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._retry = node.create_timer(_RETRY, self.load_if_possible, clock=wall)
        self._retry.cancel()
        self._crowd = EncoderCrowd(node)
        self._announced = None  # number of the cycle of the goal, None before the first one
        self._log_refusal = LogThrottle(node.get_logger(), is_error=True)
        self._pieces = CyclePieces(machine, events, law, self._log_refusal)
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
        self._loaded = self._pieces.put_in_force(index) or self._loaded
        return True

    def drop(self):
        """Drop the loaded cycle; the law starts the next one as after power-up."""
        self.cycle.end()
        self._pieces.clear()
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
        self._pieces.clear()
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
            if message.cycle == self.cycle.active:
                self._pieces.take(message, self._loaded)
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
            self._refuse(message.cycle, f'{error}{self._source.remark()}')
            return
        errors = np.zeros((len(trajectory), len(self._events)))
        self.cycle.wait_for(message.cycle, LoadedCycle(message, trajectory, feedforward, errors), monotonic())
        self._retry.reset()
        self.load_if_possible()

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
