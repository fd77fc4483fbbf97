"""The topic machine/standing: the positions of the motors while the machine runs no cycle."""

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_interfaces.msg import Standing
from pkm_nodes.runtime.node import LAST_VALUE_QOS

# [s, wall] period of the state of a machine that stands
PERIOD = 0.1
# periods from one report to the next of a machine that moves: one second
_MOVING_EVERY = 10


class StandingReports:
    """
    Reports the state of a machine that stands, ten times per second; of one that moves, once.

    Parameters
    ----------
    node : PkmNode
    machine : Machine
    look : callable
        Returns (cycle, tick, counts) of a machine that stands, None of one that moves: the last cycle, and the tick of
        the simulated time.
    report : callable
        ``report()`` publishes the diagnostics.

    """

    def __init__(self, node, machine, look, report):
        self._look, self._report = look, report
        self._joints, self._resolution = list(machine.joints), machine.encoder_resolution
        self._publisher = node.create_publisher(Standing, 'machine/standing', LAST_VALUE_QOS)
        self._turn = 0
        node.create_timer(PERIOD, self._on_time, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.publish()

    def publish(self):
        """Publish the positions of a machine that stands; return whether it does."""
        standing = self._look()
        if standing is None:
            return False
        cycle, tick, counts = standing
        position = (counts * self._resolution).tolist()
        self._publisher.publish(Standing(cycle=cycle, tick=tick, joints=self._joints, position=position))
        return True

    def _on_time(self):
        self._turn = (self._turn + 1) % _MOVING_EVERY
        if self.publish() or self._turn == 0:
            self._report()
