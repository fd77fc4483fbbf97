"""Node `linear_motor_<joint>`: one motor with its encoder, dN/command in, dN/encoder out, in the machine's process."""

from pkm_interfaces.msg import EncoderSample, MotorCommand
from pkm_nodes.node import TICK_QOS, PkmNode


class LinearMotorNode(PkmNode):
    """One motor with its encoder; the mechanism behind it belongs to `MachineNode`."""

    def __init__(self, joint, index, on_command, **kwargs):
        super().__init__(f'linear_motor_{joint}', **kwargs)
        self._sample = EncoderSample()
        self._publisher = self.create_publisher(EncoderSample, f'{joint}/encoder', TICK_QOS)
        self.on_tick_topic(MotorCommand, f'{joint}/command', lambda command: on_command(index, command))

    def is_heard(self):
        """Tell whether every reader of the encoder that the graph knows of is connected, and there is one."""
        return self._publisher.get_subscription_count() >= max(1, self.count_subscribers(self._publisher.topic_name))

    def publish(self, tick, cycle, index, mode, counts, position):
        """Send one encoder sample; the message object is reused, because this runs every tick."""
        sample = self._sample
        sample.tick, sample.cycle, sample.index, sample.mode = tick, cycle, index, mode
        sample.counts, sample.position = counts, position
        self._publisher.publish(sample)
