"""
Node `recorder`: one MCAP bag per motion cycle, with every sample accounted for, by `pkm_core.recording`.

Messages are taken serialized, as DDS delivers them. On recorder/tick the node reports the last tick it has recorded,
first when it is connected to every joint and to the trajectory source and has the parameters of the cell. A machine
that waits for the recorder thus neither starts too early nor overruns its queues. Each cycle results in a RECORDED or a
NOT_RECORDED event.
"""

from shutil import disk_usage

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from std_msgs.msg import UInt64

from pkm_core.errors import ConfigError
from pkm_core.machines.geometry import load_geometry
from pkm_core.recording.folder_lock import FolderLock
from pkm_core.recording.provenance import config_hash, control_hash, git_revision, joined_hash
from pkm_core.recording.recording import Recording
from pkm_core.recording.topics import By, recorded_topics
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.conversions import time_of_tick
from pkm_nodes.messages.diagnostics import FAILURE, FOREIGN, OTHERS, STATE, TICK, diagnostics
from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.parts.cycle_events import CycleEvents, EventGate
from pkm_nodes.parts.graph_parameters import GraphParameters
from pkm_nodes.parts.loaded_config import CONFIG_HASH, TRUTH_HASH
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.runtime.groups import PatientGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CYCLE_QOS, EVENT_QOS, LAST_VALUE_QOS, TICK_QOS, PkmNode, entry_point
from pkm_nodes.runtime.patient_subscription import PatientSubscription

# topics of the servo tick and its states: deep queues
_WITH_TICKS = (By.TICK, By.STAMP, By.TIME)
# [s] of simulated time; the longest pre-roll of four joints takes some 100 MB
_LONGEST_PREROLL = 60.0


class RecorderNode(PkmNode):
    """
    Writes the cycles of a cell into `folder`.

    Parameters
    ----------
    neighbours : sequence of PkmNode
        Other nodes of this process, whose subscriptions of the servo tick are tapped. Subscriptions of its own, eight
        more deliveries and takes per tick, would cost as much as all the rest of recording.

    """

    def __init__(self, neighbours=(), **kwargs):
        super().__init__('recorder', **kwargs)
        machine_name = self.machine_setting()
        control = self.control_setting()
        folder = self.setting('folder', 'bags', 'folder of the bags, one per cycle')
        preroll = self.setting('preroll', 1.0, 'simulated time [s] that a snapshot reaches back')
        self.check_settings()
        if preroll > _LONGEST_PREROLL:
            raise ConfigError(f'recorder: preroll is {preroll} s; allowed: at most {_LONGEST_PREROLL:.0f} s')
        self._geometry = NodeGeometry(self, load_geometry(machine_name))
        machine = self._geometry.machine
        self._configuration = machine.configuration
        self._control_at_start = control_hash(machine, control)
        self._sample_time, self._joints = machine.sample_time, machine.joints
        topics = {self.resolve_topic_name(topic.name): topic for topic in recorded_topics(machine.joints)}
        self._parameters_of_cell = GraphParameters(self)
        self._lock = FolderLock(folder)
        warn = LogThrottle(self.get_logger())
        self._recording = Recording(self._lock.path, topics, machine, preroll, self._facts, warn, self._is_offered)
        self._queue = PatientGroup(self._serve)
        self._tick_subscriptions = []
        self._guarded = []  # PatientSubscription
        taken = {s.topic_name: s for node in neighbours for s in node.tick_subscriptions}
        for name, topic in topics.items():
            self._listen(name, topic, taken.get(name))
        self._progress = self.create_publisher(UInt64, 'recorder/tick', TICK_QOS)
        self._reported = None
        self._events = CycleEvents(self, 'recorder')
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', LAST_VALUE_QOS)
        self._closed, self._lost, self._failure = 0, 0, ''
        self.offer('recorder/record', self._recording.start)
        self.offer('recorder/stop', self._recording.stop)
        self.offer('recorder/split_bagfile', self._recording.split)
        self.offer('recorder/snapshot', lambda: str(self._recording.snapshot().resolve()))
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.1, self._look_after, clock=wall)
        self.create_timer(1.0, self._publish_diagnostics, clock=wall)
        self._announcer = self.create_timer(0.2, self._announce, clock=wall)
        self._connected = 0

    def _listen(self, name, topic, taken):
        """Record a topic; `taken` is the `TickSubscription` of a neighbour to the same topic, or None."""
        message_type, take = find_interface(topic.kind, 'msg'), self._recording.takers[name]
        if taken is not None:
            taken.tap(take)
            if topic.by is By.TICK:
                self._tick_subscriptions.append(taken)
            return
        # one group for all: events served after the ticks of many cycles would end the wrong cycle
        qos = TICK_QOS if topic.by in _WITH_TICKS else EVENT_QOS if topic.by is By.EVENT else CYCLE_QOS
        if topic.by not in (By.EVENT, By.ARRIVAL):  # the machine starts only with one publisher of each
            besides = 'pose_trajectory' if topic.name == 'joint_trajectory' else None
            self._guarded.append(PatientSubscription(self, message_type, name, take, qos, self._queue, besides=besides))
        else:
            take = self._take_events(take, name) if topic.by is By.EVENT else _ignoring_senders(take)
            self.create_subscription(message_type, name, take, qos, callback_group=self._queue, raw=True)
        if topic.by is By.TICK:
            self._tick_subscriptions.append(self._guarded[-1])

    def _take_events(self, take, topic):
        """Return a function that passes events which may be believed to `take`."""
        gate = self._gate = EventGate(self, topic, self._joints)

        def take_genuine(messages, senders=None):
            rows = [messages] if isinstance(messages, bytes) else [row.tobytes() for row in messages]
            gids = len(rows) * [b''] if senders is None else [gid.tobytes() for gid in senders]
            for row, gid in zip(rows, gids, strict=True):
                if gate.event_in(row, gid) is not None:
                    take(row)

        take_genuine.denials = gate.denials
        return take_genuine

    def _facts(self, motion, law):
        """Return the metadata of a bag that name software, configuration and parameters."""
        # a controller that is not of this project has no such parameter: then the files at the start of this node count
        geometry = self._geometry.geometry
        at_start = joined_hash(geometry.file_hash, self._control_at_start)
        loops = self._parameters_of_cell.values_of(CONFIG_HASH) or [at_start]
        loops = [*loops, *self._parameters_of_cell.values_of(TRUTH_HASH)]
        tool_law = next(iter(self._parameters_of_cell.values_of('tool_law')), '')
        return {
            'machine': geometry.file,
            'geometry': geometry.digest,
            'session': self.session,
            'git_revision': git_revision(),
            'config_hash': config_hash(loops, motion, law, self._configuration, tool_law),
            'parameters': self._parameters_of_cell.as_json(),
        }

    def _is_offered(self, topic):
        return self.context.ok() and self.count_publishers(topic) > 0  # at the end there is no graph to read

    # progress

    def _serve(self):
        """Sort the messages since the last turn; report progress and outcomes."""
        self._recording.sort()
        if self._reported is not None and self._recording.progress != self._reported:
            self._report_progress()
        while self._recording.outcomes:
            self._report_outcome(self._recording.outcomes.pop(0))

    def _announce(self):
        """Report progress once all topics of a cycle are connected, and again after a reconnection."""
        self._parameters_of_cell.look_around()
        for guarded in self._guarded:
            guarded.look()
        before = self._connected
        self._connected = sum(s.get_publisher_count() > 0 for s in self._tick_subscriptions) + self._is_led()
        connected = before == self._connected == len(self._tick_subscriptions) + 1
        if connected and self._parameters_of_cell.is_complete():
            self._report_progress()
            self._announcer.timer_period_ns = 1_000_000_000

    def _is_led(self):
        """Return whether joint_trajectory has a publisher other than trajectory_generator, which identifies only."""
        publishers = self.get_publishers_info_by_topic('joint_trajectory')
        return any(info.node_name != 'trajectory_generator' and info.node_name[0] != '_' for info in publishers)

    def _report_progress(self):
        self._reported = self._recording.progress
        self._progress.publish(UInt64(data=max(0, self._reported)))

    def _look_after(self):
        self._recording.close_late()
        self._serve()

    # outcomes

    def _report_outcome(self, outcome):
        if outcome.failure:
            self._failure = f'cycle {outcome.cycle}: {outcome.failure}'
            self.get_logger().error(f'not recorded: {self._failure}')
            event, text = CycleEvent.NOT_RECORDED, {'message': outcome.failure}
        else:
            self._closed, self._failure = self._closed + 1, ''
            self._lost += sum(outcome.lost.values())
            event, text = CycleEvent.RECORDED, {'bag': str(outcome.path)}
            if outcome.lost:
                self.get_logger().error(
                    f'cycle {outcome.cycle}: messages missing in {outcome.path}: {outcome.lost}; '
                    f'first and last of the ticks missing: {outcome.lost_ticks}'
                )
            if outcome.surplus:
                self.get_logger().error(
                    f'cycle {outcome.cycle}: more messages than expected in {outcome.path}: {outcome.surplus}; '
                    f'these topics may have further publishers'
                )
        if self.context.ok():  # otherwise the bag is readable, but the context cannot publish
            self._events.publish(event, outcome.cycle, tick=outcome.tick, samples=outcome.messages, **text)

    def _publish_diagnostics(self):
        recording = self._recording
        state = 'recording' if recording.running else 'stopped'
        try:
            free = f'{disk_usage(self._lock.path).free / 1e6:.0f}'
        except OSError as error:
            free = error.strerror
        counts = {'bags': self._closed, 'lost messages': self._lost, TICK: recording.progress, 'free [MB]': free}
        foreign = sum(each.foreign for each in self._guarded) + self._gate.foreign
        others = '; '.join(f'{each.topic_name}: {", ".join(each.others)}' for each in self._guarded if each.others)
        message = diagnostics(
            self,
            DiagnosticStatus.ERROR if self._failure else DiagnosticStatus.WARN if foreign else DiagnosticStatus.OK,
            f'not recorded: {self._failure}' if self._failure else state,
            {STATE: state, FAILURE: self._failure, **counts, FOREIGN: foreign, OTHERS: others},
            time_of_tick(max(0, recording.progress), self._sample_time),
        )
        self._diagnostics.publish(message)

    def destroy_node(self):
        """Close open bags, so that a cell stopped during a cycle leaves readable bags."""
        self._recording.close_all()
        while self._recording.outcomes:
            self._report_outcome(self._recording.outcomes.pop(0))
        self._lock.release()
        super().destroy_node()


def _ignoring_senders(take):
    """Return a callback of a `PatientGroup` that passes the messages of every sender to `take`."""

    def take_all(messages, senders=None):
        take(messages)

    return take_all


main = entry_point(RecorderNode)
