"""What every controller of the cell does between ticks: load a cycle, say so, and account for it afterwards."""

from abc import ABC, abstractmethod
from time import monotonic

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.metrics import axis_metrics
from pkm_interfaces.msg import CycleEvent, CycleMetrics, MotorCommand, SampledTrajectory
from pkm_nodes.messages.conversions import feedforward_from_msg, trajectory_from_msg
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.runtime.node import CYCLE_QOS, PkmNode

# [s, wall] how long a cycle waits for readers of the commands that are known but not connected, a recorder coming up
DISCOVERY = 2.0


class ControllerNode(PkmNode, ABC):
    """
    A controller of one or more joints; the law is that of a subclass.

    A cycle is reported as LOADED when its trajectory is in place, and what has been learned. While a cycle runs nothing
    but its end, a safe stop, a STOP event or a reset of the machine changes what is loaded.
    """

    def __init__(self, name, kind, **kwargs):
        super().__init__(name, **kwargs)
        self._machine = load_machine(self.setting('machine', 'four_dof', 'machine of config/machines, or a YAML file'))
        chosen = self.setting('control', kind, f"'{kind}' for the machine's own, a file of config, or a YAML file")
        self._control = choose_control(self._machine, chosen)
        if kind_of(self._control) != kind:
            raise ConfigError(f'{name}: control {chosen!r} is for {kind_of(self._control)}; this node is for {kind}')

    def _serve(self, joints):
        """Take part in the cycles of the cell with `joints`; to be called once, at the end of construction."""
        self._joints = joints
        self._message = self._trajectory = None  # of the cycle that is loaded
        self._waiting = None  # message, trajectory and feedforward of the one to be loaded
        self._patient_until = 0.0
        self._loaded = self._running = False
        self._errors = np.zeros((0, len(joints)))
        self._events = {joint: CycleEvents(self, joint) for joint in joints}
        publishers = [self.tick_publisher(MotorCommand, f'{joint}/command') for joint in joints]
        self._commands, self._senders = zip(*publishers, strict=True)
        self._metrics = [self.create_publisher(CycleMetrics, f'{joint}/cycle_metrics', CYCLE_QOS) for joint in joints]
        subscribe_events(self, self._on_event)  # first: a reset must not come after the trajectory that follows it
        self.create_subscription(SampledTrajectory, 'joint_trajectory', self._on_trajectory, CYCLE_QOS)
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._retry = self.create_timer(0.05, self._load_if_possible, clock=wall)
        self._retry.cancel()
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(1.0, self._publish_diagnostics, clock=wall)

    @abstractmethod
    def _load(self, trajectory, feedforward):
        """
        Load the cycle of `self._message`: its `SampledTrajectory`, and what it begins with, (N, joints) [V] or None.

        Raises `PkmError` if that cannot be driven.
        """

    @abstractmethod
    def _reset(self):
        """Forget the state of the law; the machine stands, at home or after a safe stop."""

    def _check(self, message):
        """Raise `PkmError` if the law cannot drive the cycle of this joint_trajectory."""

    def _is_busy(self, message):
        """Tell whether the cycle of this joint_trajectory has to wait for something here."""
        return False

    def _learn(self):
        """Learn from the cycle that has ended."""

    def _warning(self):
        """Return what people should know of this controller, '' if nothing."""
        return ''

    def _on_event(self, event):
        stopped = event.event == CycleEvent.STOP and self._running and event.cycle == self._message.cycle
        if stopped or event.event == CycleEvent.RESET:
            self._drop()

    def _drop(self):
        """Drop the cycle that is loaded; the trajectory of the next one begins as after power-up."""
        self._loaded = self._running = False
        self._reset()

    def _on_trajectory(self, message):
        """Take over the trajectory of the coming cycle, unless it is the one already loaded."""
        if self._loaded and message.cycle == self._message.cycle:
            self._report_loaded()
            return
        machine = self._machine
        try:
            if self._running:
                raise PkmError(
                    f'trajectory of cycle {message.cycle}: cycle {self._message.cycle} is running; wait for its end, '
                    f'or call machine/reset if it has none'
                )
            trajectory = trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)
            feedforward = feedforward_from_msg(message, trajectory.position.shape)
            self._check(message)
        except PkmError as error:
            self._refuse(message.cycle, error)
            return
        if self._waiting is None or self._waiting[0].cycle != message.cycle:
            self._patient_until = monotonic() + DISCOVERY
        self._waiting = message, trajectory, feedforward
        self._loaded = False
        self._retry.reset()
        self._load_if_possible()

    def _refuse(self, cycle, error):
        self.get_logger().error(f'joint_trajectory refused: {error}')
        for events in self._events.values():
            events.publish(CycleEvent.REFUSED, cycle, message=str(error))

    def _load_if_possible(self):
        """Load the waiting trajectory once nothing is in the way and the machine listens."""
        if self._waiting is None or self._is_busy(self._waiting[0]) or not all(map(self._is_heard, self._commands)):
            return
        self._retry.cancel()
        (self._message, self._trajectory, feedforward), self._waiting = self._waiting, None
        self._errors = np.zeros((len(self._trajectory), len(self._joints)))
        try:
            self._load(self._trajectory, feedforward)
        except PkmError as error:
            self._refuse(self._message.cycle, error)
            return
        self._loaded = True
        self._report_loaded()

    def _is_heard(self, publisher):
        """Tell whether all readers that the graph knows of are connected, or one after they have had their time."""
        known = self.count_subscribers(publisher.topic_name) if monotonic() < self._patient_until else 1
        return publisher.get_subscription_count() >= max(1, known)

    def _report_loaded(self):
        for events in self._events.values():
            events.publish(CycleEvent.LOADED, self._message.cycle, samples=len(self._trajectory))

    def _publish_diagnostics(self):
        warning = self._warning()
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if warning else DiagnosticStatus.OK,
            name=self.get_fully_qualified_name(),
            message=warning or ('cycle running' if self._running else 'cycle loaded' if self._loaded else 'standing'),
            values=[KeyValue(key='cycle', value=str(self._message.cycle if self._message else 0))],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _finish_cycle(self):
        self._loaded = self._running = False
        moves = self._trajectory.move_starts, self._trajectory.move_ends
        for joint, error, publisher in zip(self._joints, self._errors.T, self._metrics, strict=True):
            metrics = axis_metrics(error, *moves, self._machine.sample_time)
            publisher.publish(
                CycleMetrics(
                    cycle=self._message.cycle,
                    joint=joint,
                    max_dynamic_error=metrics.max_dynamic_error,
                    settling_time_5um=metrics.settling_time_5um,
                    settling_time_1um=metrics.settling_time_1um,
                    steady_state_error=metrics.steady_state_error,
                )
            )
        self._learn()
