"""
Node `joint_controller`: one axis; answers every encoder tick with a command, learns after every cycle.

The law is `RobustController` of pkm_core; the feedforward of the next cycle comes from the learning service. A cycle is
reported as LOADED when its trajectory and the learned feedforward are both in place. In a cycle of identification the
excitation stands in the place of the latter: it is added to the voltage, and an axis that leaves its bounds is not
answered for, but stopped.
"""

import sys
from array import array

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController, load_control
from pkm_core.errors import ConfigError, PkmError
from pkm_core.identification import IdentificationError
from pkm_core.machines import load_machine
from pkm_core.metrics import axis_metrics
from pkm_interfaces.msg import CycleEvent, CycleMetrics, EncoderSample, MotorCommand
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_interfaces.srv import UpdateFeedforward
from pkm_nodes.conversions import IDENTIFY, trajectory_from_msg
from pkm_nodes.events import CycleEvents
from pkm_nodes.excitation import AxisExcitation
from pkm_nodes.node import CYCLE_QOS, TICK_QOS, PkmNode, run

# [s, wall] how long a cycle waits for the learning service before it goes on with the feedforward it has
LEARNING_TIMEOUT = 5.0


class JointControllerNode(PkmNode):
    """Encoder and joint_trajectory in, command out; one node a joint."""

    def __init__(self, *, name='joint_controller', **kwargs):
        super().__init__(name, **kwargs)
        machine = load_machine(self.setting('machine', 'four_dof', 'machine of config/machines, or a YAML file'))
        joint = self.setting('joint', machine.joints[0], f'which joint: one of {list(machine.joints)}')
        control = self.setting('control', '', "gains: file of config/control or a YAML file; empty for the machine's")
        self.check_settings()
        if joint not in machine.joints:
            raise ConfigError(f'{name}: joint {joint!r}; {machine.name} has {list(machine.joints)}')
        self._machine, self._joint, self._column = machine, joint, machine.joints.index(joint)
        model = load_model(machine)[joint]
        gains = load_control(machine, control or None)[joint]
        self._controller = RobustController(gains, model, machine.sample_time, machine.voltage_limit)
        self._trajectory = None  # the message whose cycle is loaded or waits for learning
        self._loaded = False
        self._errors = np.zeros(0)
        self._feedforward = np.zeros(0)
        self._learned_for = None  # (motion, law, reference) the feedforward belongs to
        self._iteration = 0
        self._learning = None  # the call to the learning service under way
        self._learning_until = 0
        self._excitation = AxisExcitation(self, machine, joint, model)
        self._excited = None  # the `ExcitedAxis` of a cycle of identification

        self._command = MotorCommand()
        self._command_publisher = self.create_publisher(MotorCommand, f'{joint}/command', TICK_QOS)
        self._metrics_publisher = self.create_publisher(CycleMetrics, f'{joint}/cycle_metrics', CYCLE_QOS)
        self._events = CycleEvents(self, joint)
        self._learn = self.create_client(UpdateFeedforward, 'learning/update')
        self._encoder = self.on_tick_topic(EncoderSample, f'{joint}/encoder', self._on_sample)
        self.create_subscription(SampledTrajectoryMessage, 'joint_trajectory', self._on_trajectory, CYCLE_QOS)
        self._wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._retry = self.create_timer(0.05, self._load_if_possible, clock=self._wall)
        self._retry.cancel()

    def _on_trajectory(self, message):
        """Take over the trajectory of the coming cycle, unless it is the one already loaded."""
        if self._trajectory is not None and self._trajectory.cycle == message.cycle and self._loaded:
            self._report_loaded()
            return
        machine = self._machine
        try:
            trajectory = trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)
        except PkmError as error:
            self._refuse(message.cycle, error)
            return
        self._trajectory, self._loaded = message, False
        self._moves = trajectory.move_starts, trajectory.move_ends
        self._axis = [
            np.ascontiguousarray(getattr(trajectory, name)[:, self._column])
            for name in ('position', 'velocity', 'acceleration', 'jerk')
        ]
        self._retry.reset()
        self._load_if_possible()

    def _refuse(self, cycle, error):
        self.get_logger().error(f'joint_trajectory refused: {error}')
        self._events.publish(CycleEvent.REFUSED, cycle, message=str(error))

    def _load_if_possible(self):
        """Load the waiting trajectory once what goes with it is there and the machine listens."""
        if self._learning is not None and self._wall.now().nanoseconds > self._learning_until:
            self.get_logger().error(
                f'no answer from {self._learn.srv_name} for {LEARNING_TIMEOUT} s; going on with the feedforward I have'
            )
            self._learning = None
        if self._learning is not None or self._command_publisher.get_subscription_count() == 0:
            return
        message, samples = self._trajectory, len(self._axis[0])
        if self._excitation.is_missing(message):
            return
        self._retry.cancel()
        try:
            self._excited = self._excitation.begin(message, self._controller.gains, *self._axis[:3])
        except PkmError as error:
            self._refuse(message.cycle, error)
            return
        learned_for = (message.motion, message.learning_law, self._axis[0].tobytes())
        if learned_for != self._learned_for:
            self._learned_for, self._iteration, self._feedforward = learned_for, 0, np.zeros(samples)
        self._errors = np.zeros(samples)
        self._controller.load(*self._axis, self._feedforward)
        self._loaded = True
        self._report_loaded()

    def _report_loaded(self):
        self._events.publish(CycleEvent.LOADED, self._trajectory.cycle, samples=len(self._errors))

    def _on_sample(self, sample):
        """Answer one encoder tick: the hot path."""
        if sample.mode != EncoderSample.RUN:
            # a safe stop: the cycle is over, and the next one begins as after power-up
            self._loaded = False
            self._controller.reset()
            return
        if not self._loaded or sample.cycle != self._trajectory.cycle:
            return
        index = sample.index
        try:
            voltage, error = self._controller.update(index, sample.position)
            if self._excited is not None:
                voltage = self._excited.drive(index, voltage, sample.position)
        except IdentificationError as reason:
            self._events.publish(CycleEvent.STOP, sample.cycle, tick=sample.tick, message=str(reason))
            return
        except PkmError as refusal:
            self.get_logger().error(f'{self._encoder.topic_name}: {refusal}; not answered')
            return
        command = self._command
        command.tick, command.cycle = sample.tick, sample.cycle
        command.voltage, command.error, command.feedforward = voltage, error, self._feedforward.item(index)
        self._command_publisher.publish(command)
        self._errors[index] = error
        if index + 1 == len(self._errors):
            self._finish_cycle()

    def _finish_cycle(self):
        message = self._trajectory
        self._loaded = False
        metrics = axis_metrics(self._errors, *self._moves, self._machine.sample_time)
        self._metrics_publisher.publish(
            CycleMetrics(
                cycle=message.cycle,
                joint=self._joint,
                max_dynamic_error=metrics.max_dynamic_error,
                settling_time_5um=metrics.settling_time_5um,
                settling_time_1um=metrics.settling_time_1um,
                steady_state_error=metrics.steady_state_error,
            )
        )
        if message.learning_law not in ('none', IDENTIFY):
            request = UpdateFeedforward.Request(
                joint=self._joint,
                law=message.learning_law,
                motion=message.motion,
                iteration=self._iteration,
                sample_time=self._machine.sample_time,
                error=array('d', self._errors.tobytes()),
                feedforward=array('d', self._feedforward.tobytes()),
            )
            self._learning = self._learn.call_async(request)
            self._learning_until = self._wall.now().nanoseconds + int(LEARNING_TIMEOUT * 1e9)
            self._learning.add_done_callback(self._on_learned)

    def _on_learned(self, future):
        if future is not self._learning:
            return
        self._learning = None
        response, samples = future.result(), len(self._feedforward)
        feedforward = np.array(response.feedforward)
        refusal = '' if response.success else f'learning refused: {response.message}'
        if response.success and (len(feedforward) != samples or not np.isfinite(feedforward).all()):
            refusal = f'learning answered {feedforward} ({len(feedforward)} values); expected {samples} finite ones'
        if refusal:
            self.get_logger().error(f'{refusal}; going on with the feedforward I have')
            return
        self._feedforward = feedforward
        self._iteration += 1


def make_nodes():
    """Return this process's node."""
    return [JointControllerNode()]


def main(args=None):
    """Run the node as a process of its own."""
    sys.exit(run(make_nodes, args))
