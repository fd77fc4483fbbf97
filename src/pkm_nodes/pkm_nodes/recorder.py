"""
Node `recorder`: one MCAP bag per motion cycle, every sample accounted for.

Messages are taken raw, as the serialized bytes DDS delivers, and sorted into cycles by the tick, cycle or stamp they
begin with. On recorder/tick it reports how far it has come, first when it is connected to every joint: a machine told
to wait for it neither starts too early nor runs out of its queue. A bag is closed when everything its cycle must hold
has arrived, then checked and announced with a RECORDED event.
"""

import json
import sys
from datetime import datetime
from functools import partial
from math import inf
from struct import unpack_from
from time import monotonic

from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt64

from pkm_core.bags import BagWriter, writable_folder
from pkm_core.errors import BagError
from pkm_core.machines import load_machine
from pkm_interfaces.msg import CycleEvent, CycleMetrics, EncoderSample, Excitation, MotorCommand
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_nodes.conversions import nanoseconds_of_tick
from pkm_nodes.events import CycleEvents
from pkm_nodes.node import CYCLE_QOS, TICK_QOS, PkmNode, run
from pkm_nodes.state_estimator import POSE_EVERY

# [messages] how often progress is reported while ticks flow
_REPORT_EVERY = 256
# [s, wall] how long a cycle that has ended may wait for the last of its messages
_STRAGGLERS = 2.0
_TYPES = {
    EncoderSample: 'pkm_interfaces/msg/EncoderSample',
    MotorCommand: 'pkm_interfaces/msg/MotorCommand',
    CycleMetrics: 'pkm_interfaces/msg/CycleMetrics',
    CycleEvent: 'pkm_interfaces/msg/CycleEvent',
    SampledTrajectoryMessage: 'pkm_interfaces/msg/SampledTrajectory',
    Excitation: 'pkm_interfaces/msg/Excitation',
    PoseStamped: 'geometry_msgs/msg/PoseStamped',
    JointState: 'sensor_msgs/msg/JointState',
}


class _Cycle:
    """The recording of one cycle; messages wait until its first tick and both trajectories are there."""

    def __init__(self, number):
        self.number = number
        self.motion = 'motion'
        self.trajectories = {}  # by topic; sent again every second until the cycle starts, the last one counts
        self.waiting = []  # (topic, data, tick or None for before the start)
        self.bag = None
        self.first_tick = self.last_tick = None
        self.end_tick = inf  # first tick that is not in it
        self.expected = {}  # messages by topic, known once the cycle has ended
        self.ended = None  # wall time

    def is_ready(self):
        """Tell whether the bag can be opened: its name, its trajectories and its times are known."""
        return self.first_tick is not None and len(self.trajectories) == 2

    def holds(self, tick):
        """Tell whether `tick` is in it, as far as its ends are known."""
        return self.first_tick is not None and self.first_tick <= tick < self.end_tick

    def is_complete(self):
        """Tell whether the cycle has ended and everything it must hold is in the bag."""
        return self.ended is not None and all(self.bag.counts[t] >= count for t, count in self.expected.items())


class RecorderNode(PkmNode):
    """Writes the cycles of a cell into `folder`."""

    def __init__(self, **kwargs):
        super().__init__('recorder', **kwargs)
        machine = load_machine(self.setting('machine', 'four_dof', 'machine of config/machines, or a YAML file'))
        self._folder = writable_folder(self.setting('folder', 'bags', 'folder that takes one bag a cycle'))
        self.check_settings()
        self._sample_time = machine.sample_time
        self._cycles = {}
        self._closed = {}  # first tick that is not in it, by cycle
        self._states = []  # (tick, topic, data) of poses and joint states that came before their tick
        self._broken = False
        self._hot_messages = 0
        self._topics = {}
        self._ticks = {}  # last tick by topic of the servo tick
        self._tick_subscriptions = []
        for joint in machine.joints:
            self._record_tick_topic(EncoderSample, f'{joint}/encoder')
            self._record_tick_topic(MotorCommand, f'{joint}/command')
            self._record(CycleMetrics, f'{joint}/cycle_metrics', self._by_cycle)
        self._record(SampledTrajectoryMessage, 'pose_trajectory', self._on_trajectory)
        self._record(SampledTrajectoryMessage, 'joint_trajectory', self._on_trajectory)
        self._record(Excitation, 'excitation', self._by_cycle)
        # with the ticks: served after them, the states of a long flow would pile up until their queue overflows
        self._record(PoseStamped, 'pose', self._by_stamp, with_ticks=True)
        self._record(JointState, 'joint_states', self._by_stamp, with_ticks=True)
        self._record(CycleEvent, 'cycle_events', self._on_event)
        self._progress = self.create_publisher(UInt64, 'recorder/tick', TICK_QOS)
        self._events = CycleEvents(self, 'recorder')
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.1, self._close_late, clock=wall)
        self._announcer = self.create_timer(0.2, self._announce, clock=wall)
        self._connected = 0

    def _record_tick_topic(self, message_type, name):
        topic = self.resolve_topic_name(name)
        self._topics[topic], self._ticks[topic] = _TYPES[message_type], -1
        subscription = self.on_tick_topic(message_type, name, lambda data: self._on_tick(topic, data), raw=True)
        self._tick_subscriptions.append(subscription)

    def _record(self, message_type, name, callback, *, with_ticks=False):
        topic = self.resolve_topic_name(name)
        self._topics[topic] = _TYPES[message_type]
        subscribe = self.on_tick_topic if with_ticks else partial(self.create_subscription, qos_profile=CYCLE_QOS)
        subscribe(message_type, name, lambda data: callback(topic, data), raw=True)

    def _on_tick(self, topic, data):
        """Take an EncoderSample or MotorCommand: tick and cycle are the first fields after the 4-byte CDR header."""
        tick, number = unpack_from('<QI', data, 4)
        if number not in self._cycles and tick < self._closed.get(number, 0):
            self._warn_of_late(topic, number)
            return
        cycle = self._cycle(number)
        if cycle.first_tick is None:
            self._start(cycle, tick)
        cycle.last_tick = tick
        self._put(cycle, topic, data, tick)
        self._ticks[topic] = tick
        if self._states:
            self._place_states()
        self._hot_messages += 1
        if self._hot_messages % _REPORT_EVERY == 0:
            self._report_progress()

    def _announce(self):
        """Report once at rest that every joint's topics are connected, and again when one of them has come back."""
        before = self._connected
        self._connected = sum(s.get_publisher_count() > 0 for s in self._tick_subscriptions)
        if before == self._connected == len(self._tick_subscriptions):
            self._report_progress()
            self._announcer.timer_period_ns = 1_000_000_000

    def _report_progress(self):
        self._progress.publish(UInt64(data=max(0, min(self._ticks.values()))))

    def _by_cycle(self, topic, data):
        """Take a message that begins with its cycle's number."""
        number = unpack_from('<I', data, 4)[0]
        if number not in self._cycles and number in self._closed:
            self._warn_of_late(topic, number)
            return
        cycle = self._cycle(number)
        self._put(cycle, topic, data, cycle.last_tick)

    def _by_stamp(self, topic, data):
        """Take a message that begins with a stamp, which is the time of its tick."""
        seconds, nanoseconds = unpack_from('<iI', data, 4)
        tick = round((seconds * 1_000_000_000 + nanoseconds) / nanoseconds_of_tick(1, self._sample_time))
        self._states.append((tick, topic, data))
        self._place_states()

    def _place_states(self):
        """Put the states whose tick has been taken into the last cycle that holds it; others may not know their end."""
        reached = max(self._ticks.values())
        placed, self._states = [s for s in self._states if s[0] <= reached], [s for s in self._states if s[0] > reached]
        for tick, topic, data in placed:
            cycles = [cycle for cycle in self._cycles.values() if cycle.holds(tick)]
            if cycles:
                self._put(cycles[-1], topic, data, tick)
            else:
                self.get_logger().warn(f'{topic}: the state of tick {tick} is of no open cycle; not recorded')

    def _on_trajectory(self, topic, data):
        trajectory = deserialize_message(data, SampledTrajectoryMessage)
        self._closed.pop(trajectory.cycle, None)  # a generator that was started anew counts from 1
        cycle = self._cycle(trajectory.cycle)
        cycle.motion = trajectory.motion
        cycle.trajectories[topic] = data
        if cycle.is_ready():
            self._flush(cycle)

    def _on_event(self, topic, data):
        event = deserialize_message(data, CycleEvent)
        if event.event in (CycleEvent.RECORDED, CycleEvent.RESET):
            return
        if event.cycle not in self._cycles and event.cycle in self._closed:
            self._warn_of_late(topic, event.cycle)
            return
        cycle = self._cycle(event.cycle)
        if event.event == CycleEvent.STARTED:
            self._start(cycle, event.tick)
        self._put(cycle, topic, data, event.tick or cycle.last_tick)
        if event.event in (CycleEvent.FINISHED, CycleEvent.FAULT) and cycle.first_tick is not None:
            cycle.end_tick = event.tick
            cycle.expected = self._expected(cycle, event)
            cycle.ended = monotonic()
            self._report_progress()
            if cycle.is_ready():
                self._flush(cycle)

    def _expected(self, cycle, event):
        """Return how many messages of each topic this cycle must have, from the machine's own account of it."""
        ticks = cycle.end_tick - cycle.first_tick
        states = sum(tick % POSE_EVERY == 0 for tick in range(cycle.first_tick, cycle.end_tick))
        finished = event.event == CycleEvent.FINISHED
        per_topic = {
            _TYPES[EncoderSample]: ticks,
            _TYPES[MotorCommand]: event.samples,
            _TYPES[CycleMetrics]: int(finished),
            _TYPES[SampledTrajectoryMessage]: 1,
            _TYPES[PoseStamped]: states,
            _TYPES[JointState]: states,
        }
        return {topic: per_topic[kind] for topic, kind in self._topics.items() if kind in per_topic}

    def _cycle(self, number):
        """Return the recording of cycle `number`."""
        if number not in self._cycles:
            self._cycles[number] = _Cycle(number)
        return self._cycles[number]

    def _start(self, cycle, tick):
        """Note the first tick of `cycle`; older ones that never started are given up."""
        cycle.first_tick = tick
        self._cycles = {n: c for n, c in self._cycles.items() if c.first_tick is not None or n > cycle.number}

    def _warn_of_late(self, topic, number):
        self.get_logger().warn(f'{topic}: a message of cycle {number} came after its bag was closed; not recorded')

    def _put(self, cycle, topic, data, tick):
        cycle.waiting.append((topic, data, tick))
        if cycle.is_ready():
            self._flush(cycle)

    def _flush(self, cycle):
        """Write what waits; close the bag if that was all."""
        if self._broken:
            cycle.waiting.clear()
            return
        try:
            if cycle.bag is None:
                cycle.bag = self._open(cycle)
            for topic, data, tick in cycle.waiting:
                time = cycle.first_tick if tick is None else tick
                cycle.bag.write(topic, data, nanoseconds_of_tick(time, self._sample_time))
            cycle.waiting.clear()
            if cycle.is_complete():
                self._close(self._cycles.pop(cycle.number))
        except (OSError, BagError) as error:
            self._broken = True
            self.get_logger().error(f'recording has stopped: {self._folder}: {error}')

    def _open(self, cycle):
        metadata = {'motion': cycle.motion, 'cycle': str(cycle.number), 'sample_time': repr(self._sample_time)}
        name = f'{cycle.motion}_{cycle.number:04d}_{datetime.now():%Y%m%dT%H%M%S}'
        bag = BagWriter(self._folder / name, self._topics, metadata)
        for topic, data in cycle.trajectories.items():
            bag.write(topic, data, nanoseconds_of_tick(cycle.first_tick, self._sample_time))
        return bag

    def _close_late(self):
        """Close a cycle whose stragglers have not come; what is missing is said."""
        for number, cycle in list(self._cycles.items()):
            if cycle.ended is not None and monotonic() - cycle.ended > _STRAGGLERS:
                self._flush(cycle)
                if number in self._cycles and not self._broken:
                    self._close(self._cycles.pop(number))

    def _close(self, cycle):
        lost = {
            topic: f'{cycle.bag.counts[topic]} of {count}'
            for topic, count in cycle.expected.items()
            if cycle.bag.counts[topic] < count
        }
        if lost:
            self.get_logger().error(f'cycle {cycle.number}: messages missing in {cycle.bag.path}: {lost}')
        self._closed[cycle.number] = cycle.end_tick
        cycle.bag.close({'expected': json.dumps(cycle.expected)})
        if not self.context.ok():  # stopped in the middle: the bag is whole, but there is nobody to tell
            return
        path, total = str(cycle.bag.path.resolve()), cycle.bag.counts.total()
        self._events.publish(CycleEvent.RECORDED, cycle.number, tick=cycle.last_tick, samples=total, message=path)

    def destroy_node(self):
        """Close whatever is open, so that a cell that is stopped in the middle leaves whole bags."""
        for cycle in self._cycles.values():
            if cycle.bag is not None:
                self._close(cycle)
        self._cycles.clear()
        super().destroy_node()


def make_nodes():
    """Return this process's node."""
    return [RecorderNode()]


def main(args=None):
    """Run the node as a process of its own."""
    sys.exit(run(make_nodes, args))
