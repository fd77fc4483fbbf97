"""Events of a motion cycle as messages on /pkm/cycle_events."""

from collections import Counter
from time import monotonic

from rclpy.serialization import deserialize_message

from pkm_core.servo.event_sources import ANYONE
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.parts.speakers import Speakers
from pkm_nodes.runtime.denials import Denials
from pkm_nodes.runtime.groups import SenderGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CYCLE_QOS, EVENT_QOS
from pkm_nodes.runtime.one_publisher import node_name
from pkm_nodes.runtime.session import belongs

_NAMES = (
    *('LOADED', 'STARTED', 'FINISHED', 'REFUSED', 'FAULT', 'RESET', 'RECORDED', 'STOP', 'NOT_RECORDED', 'NOTICE'),
    *('ANNOUNCED', 'EXTENDED'),
)
_LITTLE_ENDIAN = b'\0\1\0\0'  # header of plain CDR
_KIND, _TEXTS = 4, 8  # places of the field `event` and of its texts, session and source, in a serialized CycleEvent
# [s, wall] for which a verdict on a kind and a sender holds, and most foreign nodes that are named
_DENIED, _MOST_OTHERS = 0.05, 5
# most events of one publisher in a second, of the kinds that every process may send
_PER_SECOND = 50
NAMES = {getattr(CycleEvent, name): name for name in _NAMES}


class CycleEvents:
    """Publishes the cycle events of one source."""

    def __init__(self, node, source):
        self._publisher = node.create_publisher(CycleEvent, 'cycle_events', CYCLE_QOS)
        self._source, self._session = source, node.session

    def publish(self, event, cycle, *, tick=0, samples=0, hold=0, message='', bag=''):
        """Publish `event` (a constant of CycleEvent) of `cycle`."""
        named = {'tick': tick, 'samples': samples, 'hold': hold, 'message': message, 'bag': bag}
        self._publisher.publish(
            CycleEvent(event=event, session=self._session, source=self._source, cycle=cycle, **named)
        )


def read_event(data):
    """Return the CycleEvent of serialized bytes; `ValueError` if they are none."""
    try:
        return deserialize_message(data, CycleEvent)
    except (RuntimeError, ValueError, OverflowError) as error:  # RMWError is a RuntimeError
        raise ValueError(f'message of {len(data)} bytes is no CycleEvent: {error}') from None


def heading(data):
    """Return name and source of a serialized CycleEvent, None if it is not in plain little-endian CDR."""
    if data[: len(_LITTLE_ENDIAN)] != _LITTLE_ENDIAN or len(data) < _TEXTS:
        return None
    at = _TEXTS + 4 + int.from_bytes(data[_TEXTS : _TEXTS + 4], 'little')  # end of the session
    at += -at % 4
    end = at + 4 + int.from_bytes(data[at : at + 4], 'little')
    source = data[at + 4 : end - 1]
    if end > len(data) or not source.isascii():
        return None
    return NAMES.get(data[_KIND]), source.decode()


class EventGate:
    """
    Decides which events a node believes: of its session, and from the node that the event names.

    Parameters
    ----------
    node : PkmNode
    topic : str
        Resolved name, for the log.
    joints : sequence of str
        See `Speakers`.
    kinds : collection of int, optional
        Constants of CycleEvent that the node uses; others are dropped unread. All of them by default.

    Attributes
    ----------
    denials : Denials
        Events that need not be read: an executor drops them. A verdict on a kind and a sender holds for a moment.
    foreign : int
        Number of events that were dropped because of their sender; of kinds that the node uses.
    """

    def __init__(self, node, topic, joints=(), kinds=tuple(NAMES)):
        self._node, self._session, self._topic = node, node.session, topic
        self._speakers, self._quota = Speakers(node, joints), _Quota()
        self.denials, self.foreign = Denials(frozenset(NAMES) - frozenset(kinds)), 0
        self._dropped = {}  # by sender: its node, and name and source of its first event
        self._warn, self._renew_at = LogThrottle(node.get_logger()), 0.0

    def event_in(self, data, sender=b''):
        """Return the CycleEvent in serialized bytes, or None if it is dropped; `sender` is the GID of its publisher."""
        if (now := monotonic()) >= self._renew_at:
            self._renew_at = now + _DENIED
            self.foreign += self.denials.renew()
        if len(data) > _KIND and self.denials.denies(data[_KIND], sender):  # taken before the verdict
            self.foreign += not self.denials.is_unused(data[_KIND])
            return None
        found = heading(data)
        if found is not None and not self._is_believed(*found, sender, data[_KIND]):
            return None
        try:
            event = read_event(data)
        except ValueError as error:
            self._warn(f'{self._topic}: {error}; dropped')
            return None
        if not belongs(event.session, self._session):
            return None
        # the heading of a foreign byte order is known only now
        if found is None and not self._is_believed(NAMES.get(event.event), event.source, sender, event.event):
            return None
        return event

    def foreign_nodes(self):
        """
        Return the nodes, some at most, whose events were dropped since the last call.

        A node of the cell whose first event was faster than the news of its publishers is not among them: its event
        would be believed now.
        """
        dropped, self._dropped = self._dropped, {}
        if not dropped:
            return []
        self._speakers.look()
        names = self._nodes()  # the name of a node arrives later than its publishers
        foreign = {
            names.get(sender, node)
            for sender, (node, event, source) in dropped.items()
            if event is None or event in ANYONE or not self._speakers.is_genuine(event, source, sender)
        }
        return sorted(filter(None, foreign))

    def _nodes(self):
        """Return the names of the nodes that publish events, by GID."""
        infos = self._node.get_publishers_info_by_topic(self._topic)
        return {bytes(info.endpoint_gid): node_name(info) for info in infos}

    def _is_believed(self, name, source, sender, kind):
        reason = 'not of the node of this cell that sends it'
        if name in ANYONE and sender and not self._quota.has(sender):
            reason = f'more than {_PER_SECOND} per second of one publisher'
        elif name is not None and self._speakers.is_genuine(name, source, sender):
            return True
        self.foreign += 1
        if sender:
            self.denials.deny(kind, sender, _DENIED)
            if sender not in self._dropped and len(self._dropped) < _MOST_OTHERS:
                self._dropped[sender] = self._nodes().get(sender), name, source
        named = f'{name or "unknown event"} of source {source[:40]!r}'
        self._warn(f'{self._topic}: {named} dropped: {reason}; dropped since the start: {self.foreign}')
        return False


class _Quota:
    """At most `_PER_SECOND` events per second and publisher: of kinds that every process may send, a flood is cut."""

    def __init__(self):
        self._second, self._counts = 0, Counter()

    def has(self, sender):
        """Return whether another event of `sender` is within its quota, and count it."""
        if (second := int(monotonic())) != self._second:
            self._second = second
            self._counts.clear()
        self._counts[sender] += 1
        return self._counts[sender] <= _PER_SECOND


def subscribe_events(node, callback, joints=(), *, kinds=tuple(NAMES)):
    """
    Call `callback(CycleEvent)` for events that pass an `EventGate` of `node`, and return the gate.

    `joints` and `kinds` are those of the gate.
    """

    def on_message(data, sender=b''):
        event = gate.event_in(data, sender)
        if event is not None:
            callback(event)

    gate = EventGate(node, node.resolve_topic_name('cycle_events'), joints, kinds)
    on_message.denials = gate.denials
    node.create_subscription(CycleEvent, 'cycle_events', on_message, EVENT_QOS, callback_group=SenderGroup(), raw=True)
    return gate
