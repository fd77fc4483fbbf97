"""
Node `computed_torque_controller`: all axes; answers every encoder tick with one command per joint.

One node for all joints, because M(q) couples them. The law is `ComputedTorque` of pkm_core; it does not learn.
"""

from functools import partial

import numpy as np

from pkm_core.control.controllers import make_controller
from pkm_core.errors import PkmError
from pkm_core.motion.pieces import rows_from
from pkm_interfaces.msg import EncoderSample
from pkm_nodes.messages.conversions import is_identification
from pkm_nodes.messages.tick_messages import ENCODER_SAMPLE, MOTOR_COMMAND
from pkm_nodes.parts.cycle_controller import CycleController, choose_gains, following_error_limit
from pkm_nodes.parts.cycle_events import CycleEvents
from pkm_nodes.parts.cycle_law import CycleLaw
from pkm_nodes.parts.loaded_config import LoadedConfig
from pkm_nodes.runtime.node import PkmNode, entry_point


class ComputedTorqueControllerNode(PkmNode):
    """Encoders and joint_trajectory in, commands out."""

    def __init__(self, **kwargs):
        super().__init__('computed_torque_controller', **kwargs)
        machine, chosen, gains = choose_gains(self, 'computed_torque')
        self._limit = following_error_limit(self)
        self.check_settings()
        self._config = LoadedConfig(self, machine, chosen)
        self._joints = joints = machine.joints
        self._controller = make_controller(machine, gains)
        self._tick = -1
        self._measured = np.zeros(len(joints))  # [m] at self._tick
        self._missing = set()  # columns without a sample of self._tick
        self._errors = np.zeros((0, len(joints)))  # [m] of the loaded cycle, one row per sample
        law = CycleLaw(load=self._load, reset=self._controller.reset, extend=self._extend, check=_check)
        events = {joint: CycleEvents(self, joint) for joint in joints}
        self._cycles = CycleController(self, machine, events, law, self._limit)
        self._cycle, self._senders = self._cycles.cycle, self._cycles.senders
        for column, joint in enumerate(joints):
            self.on_tick_topic(
                EncoderSample, f'{joint}/encoder', partial(self._on_sample, column), size=ENCODER_SAMPLE.size
            )

    def _load(self, loaded):
        self._errors = loaded.errors
        self._controller.load(loaded.trajectory, np.zeros_like(loaded.trajectory.position))

    def _extend(self, loaded, offset):
        piece = rows_from(loaded.trajectory, offset)
        self._controller.check(piece)

        def put_in_force():
            self._controller.extend(offset, *piece.derivatives())
            self._errors = loaded.errors

        return put_in_force

    def _on_sample(self, column, data):
        """Take the sample of one encoder; the last one of a tick makes all commands: the hot path."""
        tick, cycle, index, mode, _, position = ENCODER_SAMPLE.unpack(data)
        if mode != EncoderSample.RUN and not self._cycles.extended(mode, index):
            return
        if cycle != self._cycle.active:
            return
        if tick != self._tick:
            self._tick = tick
            self._missing.update(range(len(self._measured)))
        self._measured[column] = position
        self._missing.discard(column)
        if self._missing:
            return
        try:
            voltages, errors = self._controller.update(index, self._measured)
        except PkmError as refusal:
            self.get_logger().error(f'tick {tick}: {refusal}; not answered')
            return
        errors_now = errors.tolist()
        for joint, error in zip(self._joints, errors_now, strict=True):
            if not -self._limit <= error <= self._limit:
                self._cycles.stop(tick, joint, error)
                return
        self._cycle.running = True
        for send, voltage, error in zip(self._senders, voltages.tolist(), errors_now, strict=True):
            send(MOTOR_COMMAND.pack(tick, cycle, voltage, error, 0.0))
        self._errors[index] = errors
        if index + 1 == len(self._errors):
            self._cycles.finish()


def _check(message):
    """Raise `PkmError` if computed torque cannot drive the cycle of a joint_trajectory message."""
    if is_identification(message):
        raise PkmError('kind IDENTIFICATION: computed torque takes no excitation; expected MOTION')
    if message.learning_law != 'none':
        raise PkmError(f'learning_law {message.learning_law!r}: computed torque learns nothing; expected none')
    if message.feedforward:
        raise PkmError(f'{len(message.feedforward)} values of feedforward: computed torque takes none')


main = entry_point(ComputedTorqueControllerNode)
