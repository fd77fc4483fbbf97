"""Events of a motion cycle as messages on /pkm/cycle_events."""

from pkm_interfaces.msg import CycleEvent
from pkm_nodes.runtime.node import CYCLE_QOS
from pkm_nodes.runtime.session import belongs

_NAMES = ('LOADED', 'STARTED', 'FINISHED', 'REFUSED', 'FAULT', 'RESET', 'RECORDED', 'STOP', 'NOT_RECORDED', 'NOTICE')
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


def subscribe_events(node, callback):
    """Call `callback(CycleEvent)` for every event of the session of `node`, see session.py."""

    def of_this_session(event):
        if belongs(event.session, node.session):
            callback(event)

    return node.create_subscription(CycleEvent, 'cycle_events', of_this_session, CYCLE_QOS)
