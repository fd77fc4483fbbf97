"""Node `laser`: displacement of the end point, measured independently of the encoders; in the machine's process."""

from pkm_core.plant.laser import Laser
from pkm_interfaces.msg import LaserSample
from pkm_nodes.messages.template import DOUBLE, Template
from pkm_nodes.runtime.node import PkmNode


class LaserNode(PkmNode):
    """Publishes the samples of the simulated `Laser`."""

    def __init__(self, machine, seed, environment, **kwargs):
        super().__init__('laser', **kwargs)
        self._laser = Laser(machine, seed, environment)
        self._publisher, self._send = self.tick_publisher(LaserSample, 'laser')
        self._sample = Template(LaserSample(time=DOUBLE, displacement=len(machine.coordinates) * [DOUBLE]))
        self.zero, self.observe, self.stand = self._laser.zero, self._laser.observe, self._laser.stand

    def is_heard(self):
        """Return whether all subscribers in the graph are connected; there may be none."""
        return self._publisher.get_subscription_count() >= self.count_subscribers(self._publisher.topic_name)

    def publish(self):
        """Publish the samples since the last call."""
        for time, displacement in zip(*self._laser.read(), strict=True):
            self._send(self._sample.filled([time, *displacement]))
