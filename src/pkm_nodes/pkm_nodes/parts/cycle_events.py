"""Events of a motion cycle as messages on /pkm/cycle_events."""

from rclpy.serialization import deserialize_message

from pkm_interfaces.msg import CycleEvent
from pkm_nodes.parts.speakers import Speakers
from pkm_nodes.runtime.groups import SenderGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CYCLE_QOS, EVENT_QOS
from pkm_nodes.runtime.session import belongs

_NAMES = (
    *('LOADED', 'STARTED', 'FINISHED', 'REFUSED', 'FAULT', 'RESET', 'RECORDED', 'STOP', 'NOT_RECORDED', 'NOTICE'),
    'ANNOUNCED',
)
_KIND = 4  # place of the field `event` in a serialized CycleEvent
NAMES = {getattr(CycleEvent, name): name for name in _NAMES}


class CycleEvents:
    """Publishes the cycle events of one source."""

    def __init__(self, node, source):
        self._publisher = node.create_publisher(CycleEvent, 'cycle_events', CYCLE_QOS)
        self._source, self._session = source, node.session

    def publish(self, event, cycle, *, tick=0, samples=0, message='', bag=''):
        """Publish `event` (a constant of CycleEvent) of `cycle`."""
        named = {'tick': tick, 'samples': samples, 'message': message, 'bag': bag}
        self._publisher.publish(
            CycleEvent(event=event, session=self._session, source=self._source, cycle=cycle, **named)
        )


def read_event(data):
    """Return the CycleEvent of serialized bytes; `ValueError` if they are none."""
    try:
        return deserialize_message(data, CycleEvent)
    except (RuntimeError, ValueError, OverflowError) as error:  # RMWError is a RuntimeError
        raise ValueError(f'message of {len(data)} bytes is no CycleEvent: {error}') from None


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

    """

    def __init__(self, node, topic, joints=()):
        self._session, self._topic, self._speakers = node.session, topic, Speakers(node, joints)
        self._warn = LogThrottle(node.get_logger())

    def event_in(self, data, sender=b''):
        """Return the CycleEvent in serialized bytes, or None if it is dropped; `sender` is the GID of its publisher."""
        name = NAMES.get(data[_KIND]) if len(data) > _KIND else 'message without a kind'
        if name is None or self._speakers.is_foreign(name, sender):
            self._warn(f'{self._topic}: {name or data[_KIND]} dropped: not of the node of this cell that sends it')
            return None
        try:
            event = read_event(data)
        except ValueError as error:
            self._warn(f'{self._topic}: {error}; dropped')
            return None
        if not belongs(event.session, self._session):
            return None
        if self._speakers.is_genuine(name, event.source, sender):
            return event
        source = event.source[:40]
        self._warn(f'{self._topic}: {name} of source {source!r} dropped: not of the node of this cell that sends it')
        return None


def subscribe_events(node, callback, joints=()):
    """Call `callback(CycleEvent)` for every event that passes the `EventGate` of `node`; `joints` as there."""

    def on_message(data, sender=b''):
        event = gate.event_in(data, sender)
        if event is not None:
            callback(event)

    group = SenderGroup()
    subscription = node.create_subscription(
        CycleEvent, 'cycle_events', on_message, EVENT_QOS, callback_group=group, raw=True
    )
    gate = EventGate(node, subscription.topic_name, joints)
    return subscription
