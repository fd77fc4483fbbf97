"""The topic /clock of the machine: the time of its ticks and, if it is continuous, of the rest between cycles."""

from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock as ClockMessage

from pkm_core.errors import ConfigError
from pkm_core.servo.pace import TIME, TIMES, RestClock, rest_step
from pkm_nodes.messages.conversions import time_of_tick

# [ticks] common multiple of the periods of all topics with a rate in ticks
_PHASES = 100
# [s, wall] period of /clock at rest
_AT_REST = 0.01


class MachineTime:
    """
    Publishes /clock for `node`, the machine, and has its parameter `time`.

    Parameters
    ----------
    node : PkmNode
    machine : Machine

    Raises
    ------
    ConfigError
        If `time` is unknown, or cannot be continuous with the sample times of `machine`.

    """

    def __init__(self, node, machine):
        self._node, self._sample_time = node, machine.sample_time
        time = node.setting('time', TIMES[0], TIME)
        if time not in TIMES:
            raise ConfigError(f'{node.get_fully_qualified_name()}: time: {time!r} given; allowed: {", ".join(TIMES)}')
        self._rest = None
        if time == 'continuous':
            self._rest = RestClock(rest_step(machine.sample_time, machine.laser_sample_time, _PHASES))
        self._publisher = node.create_publisher(ClockMessage, '/clock', qos_profile_sensor_data)

    def serve(self, run, barrier, pace):
        """Let time pass from now on while the `CycleRun` runs no cycle, at the `Pace`, or in real time without one."""
        self._run, self._barrier, self._pace = run, barrier, pace
        if self._rest:
            self._node.create_timer(_AT_REST, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self, tick):
        """Publish the time of `tick`."""
        self._publisher.publish(ClockMessage(clock=time_of_tick(tick, self._sample_time)))

    @property
    def tick(self):
        """The tick of the simulated time; between cycles of the next one, later if the time is continuous."""
        return self._barrier.tick + (self._rest.ticks if self._rest else 0)

    def now(self):
        """Return the simulated time as a message."""
        return time_of_tick(self.tick, self._sample_time)

    def leave_rest(self, laser):
        """Let the first tick of a cycle come after the time at rest, during which `laser`, a node, measures nothing."""
        rest = self._rest.leave() if self._rest else 0
        if rest:
            self._barrier.tick += rest
            laser.stand(rest)
            self._run.rested(rest, self._barrier.tick, monotonic())

    def _look(self):
        if not self._run.is_running:
            rate = 0.0 if self._pace.paused else (self._pace.factor or 1.0) / self._sample_time
            self._rest.look(monotonic(), rate)
            self.publish(self.tick)
