"""The topic machine/standstill: the positions of the motors while the machine runs no cycle."""

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from pkm_nodes.messages.conversions import nanoseconds_of_standstill
from pkm_nodes.messages.template import DOUBLE, STAMP, Template
from pkm_nodes.runtime.node import LAST_VALUE_QOS

# [s, wall] period of the state of a machine that stands
PERIOD = 0.1
# periods from one report to the next of a machine that moves: one second
_MOVING_EVERY = 10


class Standstill:
    """
    Reports the state of a machine that stands, ten times per second; of one that moves, once.

    Parameters
    ----------
    node : PkmNode
    machine : Machine
    look : callable
        Returns (tick, counts) of a machine that stands, None of one that moves. `tick` is the next one.
    report : callable
        ``report()`` publishes the diagnostics.

    """

    def __init__(self, node, machine, look, report):
        self._look, self._report = look, report
        self._resolution, self._sample_time = machine.encoder_resolution, machine.sample_time
        self._publisher = node.create_publisher(JointState, 'machine/standstill', LAST_VALUE_QOS)
        gaps = len(machine.joints) * [DOUBLE]
        self._message = Template(JointState(header=Header(stamp=STAMP), name=list(machine.joints), position=gaps))
        self._turn = 0
        node.create_timer(PERIOD, self._on_time, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.publish()

    def publish(self):
        """Publish the positions of a machine that stands; return whether it does."""
        standing = self._look()
        if standing is None:
            return False
        tick, counts = standing
        time = nanoseconds_of_standstill(tick, self._sample_time)
        self._publisher.publish(self._message.filled([count * self._resolution for count in counts.tolist()], time))
        return True

    def _on_time(self):
        self._turn = (self._turn + 1) % _MOVING_EVERY
        if self.publish() or self._turn == 0:
            self._report()
