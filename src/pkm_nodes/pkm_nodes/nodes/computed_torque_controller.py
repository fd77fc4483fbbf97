"""
Node `computed_torque_controller`: all axes at once; answers every encoder tick with a command a joint.

One node for all, because M(q) couples them. The law is `ComputedTorque` of pkm_core; it learns nothing.
"""

import sys
from functools import partial

import numpy as np

from pkm_core.control.controllers import make_controller
from pkm_core.errors import PkmError
from pkm_interfaces.msg import EncoderSample
from pkm_nodes.messages.tick_messages import ENCODER_SAMPLE, MOTOR_COMMAND
from pkm_nodes.parts.cycle_controller import ControllerNode
from pkm_nodes.runtime.node import run


class ComputedTorqueControllerNode(ControllerNode):
    """The encoders and joint_trajectory in, the commands out."""

    def __init__(self, **kwargs):
        super().__init__('computed_torque_controller', 'computed_torque', **kwargs)
        self.check_settings()
        joints = self._machine.joints
        self._controller = make_controller(self._machine, self._control)
        self._tick = -1
        self._measured = np.zeros(len(joints))  # [m] at self._tick
        self._missing = set()  # columns whose sample of self._tick has not come
        self._serve(joints)
        for column, joint in enumerate(joints):
            self.on_tick_topic(EncoderSample, f'{joint}/encoder', partial(self._on_sample, column), raw=True)

    def _check(self, message):
        if message.learning_law != 'none':
            raise PkmError(f'learning_law {message.learning_law!r}: computed torque learns nothing; expected none')
        if message.feedforward:
            raise PkmError(f'{len(message.feedforward)} values of feedforward: computed torque takes none')

    def _reset(self):
        self._controller.reset()

    def _load(self, trajectory, _):
        self._controller.load(trajectory, np.zeros_like(trajectory.position))

    def _on_sample(self, column, data):
        """Take one encoder's sample; the last one of a tick is answered for all: the hot path."""
        tick, cycle, index, mode, _, position = ENCODER_SAMPLE.unpack(data)
        if mode != EncoderSample.RUN:
            self._drop()
            return
        if not self._loaded or cycle != self._message.cycle:
            return
        if tick != self._tick:
            self._tick = tick
            self._missing.update(range(len(self._joints)))
        self._measured[column] = position
        self._missing.discard(column)
        if self._missing:
            return
        try:
            voltages, errors = self._controller.update(index, self._measured)
        except PkmError as refusal:
            self.get_logger().error(f'tick {tick}: {refusal}; not answered')
            return
        self._running = True
        for send, voltage, error in zip(self._senders, voltages.tolist(), errors.tolist(), strict=True):
            send(MOTOR_COMMAND.pack(tick, cycle, voltage, error, 0.0))
        self._errors[index] = errors
        if index + 1 == len(self._errors):
            self._finish_cycle()


def make_nodes():
    """Return this process's node."""
    return [ComputedTorqueControllerNode()]


def main(args=None):
    """Run the node as a process of its own."""
    sys.exit(run(make_nodes, args))
