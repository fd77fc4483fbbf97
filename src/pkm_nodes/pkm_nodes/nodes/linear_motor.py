"""Node `linear_motor_<joint>`: a motor with its encoder; dN/command in, dN/encoder out; in the machine's process."""

from functools import partial

from pkm_interfaces.msg import EncoderSample, MotorCommand
from pkm_nodes.messages.tick_messages import ENCODER_SAMPLE, MOTOR_COMMAND
from pkm_nodes.runtime.node import PkmNode


class LinearMotorNode(PkmNode):
    """A motor with its encoder; `MachineNode` simulates the mechanism."""

    def __init__(self, joint, index, on_command, **kwargs):
        super().__init__(f'linear_motor_{joint}', **kwargs)
        self._publisher, self._send = self.tick_publisher(EncoderSample, f'{joint}/encoder')
        self._command = self.on_tick_topic(
            MotorCommand, f'{joint}/command', partial(on_command, index), size=MOTOR_COMMAND.size
        )

    def is_heard(self):
        """Return whether the encoder has a subscriber and all its subscribers in the graph are connected."""
        return self._publisher.get_subscription_count() >= max(1, self.count_subscribers(self._publisher.topic_name))

    def answering_nodes(self):
        """Return the full names of the nodes that can send commands."""
        self._command.publisher.look()
        return self._command.publisher.nodes

    def publish(self, tick, cycle, index, mode, counts, position):
        """Publish one encoder sample."""
        self._send(ENCODER_SAMPLE.pack(tick, cycle, index, mode, counts, position))
