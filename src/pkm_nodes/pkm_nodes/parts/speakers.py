"""Compares the sender of a cycle event with the node that the event names."""

from dataclasses import dataclass
from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.servo.event_sources import STRICT, topics_of
from pkm_nodes.runtime.one_publisher import OnePublisher, participant

# [s, wall] between two looks at the graph because of an unknown sender: a flood of events costs no more
_LOOK_EVERY = 0.05
# topics that are remembered; a forged source can name any
_MOST = 50
# [s, wall] between two looks at the publishers of machine and recorder
_LOOK_REGULARLY = 1.0


@dataclass
class _Entry:
    publisher: OnePublisher
    look_at: float = 0.0  # [s, wall] time of the next look because of an unknown sender


class Speakers:
    """
    The publishers by which `node` recognises the sources of cycle events.

    Machine, recorder and trajectory source are the nodes whose publisher was the first on their topic. For other
    sources any publisher of the topic counts: the machine starts no cycle while there are several.
    """

    def __init__(self, node):
        self._node = node
        self._publishers = {}  # by topic
        self._strict = [self._of(topic) for topic in STRICT]
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_LOOK_REGULARLY, self._look, clock=wall)  # so that they are known before others come

    def is_genuine(self, event, source, sender):
        """
        Return whether the event may be believed.

        Parameters
        ----------
        event, source : str
            Name of the event, and the source that it names.
        sender : bytes
            GID of its publisher; b'' if that is unknown, then only the names are compared.

        """
        topics = topics_of(event, source)
        if topics is None:
            return False
        if not topics or not sender:
            return True
        found = [self._participants(topic, participant(sender), topic in STRICT) for topic in topics]
        # a topic without a publisher identifies no node: a machine of the user's own need not publish machine/cycle
        return participant(sender) in set().union(*found) or not any(found)

    def _participants(self, topic, sender, strict):
        """Return the participants that may speak, after a look at the graph if `sender` is not among them."""
        entry, now = self._of(topic), monotonic()
        if sender not in entry.publisher.participants(strict) and now >= entry.look_at:
            entry.look_at = now + _LOOK_EVERY
            entry.publisher.look()
        return entry.publisher.participants(strict)

    def _of(self, topic):
        if topic not in self._publishers:
            if len(self._publishers) >= _MOST:
                self._publishers = dict(zip(STRICT, self._strict, strict=True))
            self._publishers[topic] = _Entry(OnePublisher(self._node, topic))
        return self._publishers[topic]

    def _look(self):
        for entry in self._strict:
            entry.publisher.look()
