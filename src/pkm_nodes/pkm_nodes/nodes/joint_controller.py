"""
Node `joint_controller`: one axis; answers every encoder tick with a command, learns after every cycle.

The law is `RobustController` of pkm_core; the feedforward of the next cycle comes from the learning service. Its gains
are parameters: a change is taken over between two ticks, without a jump, and refused before if the loop would be
unstable or near it. In a cycle of identification an excitation is added to the voltage, and an axis that leaves its
bounds is not answered for, but stopped.
"""

import sys

import numpy as np

from pkm_core.control.controllers import choose_control
from pkm_core.control.margins import require_margins
from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController
from pkm_core.errors import ConfigError, PkmError
from pkm_core.identification import IdentificationError
from pkm_interfaces.msg import CycleEvent, EncoderSample
from pkm_nodes.messages.conversions import IDENTIFY
from pkm_nodes.messages.tick_messages import ENCODER_SAMPLE, MOTOR_COMMAND
from pkm_nodes.parts.axis_excitation import AxisExcitation
from pkm_nodes.parts.axis_learning import AxisLearning
from pkm_nodes.parts.cycle_controller import ControllerNode
from pkm_nodes.parts.gain_parameters import GainParameters
from pkm_nodes.runtime.node import run


class JointControllerNode(ControllerNode):
    """Encoder and joint_trajectory in, command out; one node a joint."""

    def __init__(self, *, name='joint_controller', **kwargs):
        super().__init__(name, 'robust', **kwargs)
        machine = self._machine
        joint = self.setting('joint', machine.joints[0], f'which joint: one of {list(machine.joints)}')
        if joint not in machine.joints:
            raise ConfigError(f'{name}: joint {joint!r}; {machine.name} has {list(machine.joints)}')
        self._column, self._model = machine.joints.index(joint), load_model(machine)[joint]
        self._least = {
            # chosen: 6 dB and 30 deg are the least that is usually asked of a loop; the designs have 8.5 dB and 45 deg
            'gain_margin': self.setting('least_gain_margin', 6.0, '[dB] gains that leave less are refused'),
            'phase_margin': self.setting('least_phase_margin', 30.0, '[deg] gains that leave less are refused'),
        }
        self._gains = GainParameters(self, self._control[joint], self._check_gains, self._exchange)
        self.check_settings()
        self._controller = RobustController(self._gains.gains, self._model, machine.sample_time, machine.voltage_limit)
        self._feedforward = np.zeros(0)
        self._excitation = AxisExcitation(self, machine, joint)
        self._excited = None  # the `ExcitedAxis` of a cycle of identification
        self._serve((joint,))
        self._send_command = self._senders[0]
        self._learning = AxisLearning(
            self, joint, machine.sample_time, self._events[joint], on_end=self._load_if_possible
        )
        self.offer(f'{joint}/reload', self._reload)
        self._encoder = self.on_tick_topic(EncoderSample, f'{joint}/encoder', self._on_sample, raw=True)

    def _check_gains(self, gains):
        require_margins(self.get_fully_qualified_name(), gains, self._model, self._machine.sample_time, **self._least)

    def _check(self, message):
        if message.feedforward and self._gains.gains != self._control[self._joints[0]]:
            raise PkmError(
                f'cycle {message.cycle}: learned feedforward for the gains of the configuration, but they have been '
                f'changed since; set the parameters of {self.get_fully_qualified_name()} back'
            )

    def _exchange(self, gains):
        self._controller.exchange(gains, self._model)
        self._learning.renew()

    def _reload(self):
        """Take up the model and the gains that the configuration has now."""
        joint, before = self._joints[0], self._model
        try:
            if self._running:
                raise PkmError(f'{joint}: cycle {self._message.cycle} is running; reload when it has ended')
            self._model = load_model(self._machine)[joint]
            control = choose_control(self._machine, self.get_parameter('control').value)
            if self._gains.gains == control[joint]:  # but the model may be another
                self._check_gains(control[joint])
                self._exchange(control[joint])
            else:
                self._gains.take(control[joint])
        except PkmError:
            self._model = before
            raise
        self._control = control

    def _reset(self):
        self._controller.reset()

    def _is_busy(self, message):
        return self._learning.is_under_way() or self._excitation.is_missing(message)

    def _load(self, trajectory, feedforward):
        axis = [np.ascontiguousarray(values[:, self._column]) for values in trajectory.derivatives()]
        self._excited = self._excitation.begin(self._message, self._model, self._gains.gains, *axis[:3])
        given = None if feedforward is None else np.ascontiguousarray(feedforward[:, self._column])
        self._learning.begin(self._message, axis[0], given)
        self._feedforward = self._learning.feedforward
        self._axis_errors = self._errors[:, 0]
        self._controller.load(*axis, self._feedforward)

    def _on_sample(self, data):
        """Answer one encoder tick: the hot path."""
        tick, cycle, index, mode, _, position = ENCODER_SAMPLE.unpack(data)
        if mode != EncoderSample.RUN:
            # a safe stop: the cycle is over, and the next one begins as after power-up
            self._drop()
            return
        if not self._loaded or cycle != self._message.cycle:
            return
        try:
            voltage, error = self._controller.update(index, position)
            if self._excited is not None:
                voltage = self._excited.drive(index, voltage, position)
        except IdentificationError as reason:
            self._events[self._joints[0]].publish(CycleEvent.STOP, cycle, tick=tick, message=str(reason))
            return
        except PkmError as refusal:
            self.get_logger().error(f'{self._encoder.topic_name}: {refusal}; not answered')
            return
        self._running = True
        self._send_command(MOTOR_COMMAND.pack(tick, cycle, voltage, error, self._feedforward.item(index)))
        self._axis_errors[index] = error
        if index + 1 == len(self._axis_errors):
            self._finish_cycle()

    def _warning(self):
        return self._learning.notice

    def _learn(self):
        if self._message.learning_law not in ('none', IDENTIFY):
            self._learning.learn(self._message, self._errors[:, 0].copy(), self._gains.gains)


def make_nodes():
    """Return this process's node."""
    return [JointControllerNode()]


def main(args=None):
    """Run the node as a process of its own."""
    sys.exit(run(make_nodes, args))
