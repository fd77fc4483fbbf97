"""Compares the sender of a cycle event with the node that the event names."""

from dataclasses import dataclass
from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.servo.event_sources import FIRST, topic_of, topics_of
from pkm_nodes.runtime.one_publisher import OnePublisher, participant

# [s, wall] between two looks at the graph because of an unknown sender: a flood of events costs no more
_LOOK_EVERY = 0.05
# topics that are remembered; a forged source can name any
_MOST = 50
_BESIDES = {'joint_trajectory': 'pose_trajectory'}
# [s, wall] between two looks at the publishers of machine and recorder
_LOOK_REGULARLY = 1.0
# [s, wall] the same while none is known
_LOOK_FOR_FIRST = 0.2


@dataclass
class _Entry:
    publisher: OnePublisher
    look_at: float = 0.0  # [s, wall] time of the next look because of an unknown sender


class Speakers:
    """
    The publishers by which `node` recognises the sources of cycle events.

    A source is the process whose publisher was the first on its topic, see `OnePublisher`. The publishers of machine,
    recorder, trajectory sources and `joints` are looked up regularly, those of other sources with their first event.
    """

    def __init__(self, node, joints=()):
        self._node = node
        self._publishers = {}  # by topic
        self._foreign = set()  # (event, sender) known to be foreign since the last regular look
        self._regular = [*FIRST, *(f'{joint}/command' for joint in joints)]
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._all_at = 0.0  # [s, wall] time of the next look at all of them
        node.create_timer(_LOOK_FOR_FIRST, self._look, clock=wall)  # so that they are known before others come

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
        found = [self._participants(topic, participant(sender)) for topic in topics]
        # a topic without a publisher identifies no node: a machine of the user's own need not publish machine/cycle
        return participant(sender) in set().union(*found) or not any(found)

    def is_foreign(self, event, sender):
        """Return whether `sender` may not send `event`, whatever source it names: decided before the event is read."""
        if (event, sender) in self._foreign:
            return True
        topic = topic_of(event)
        if not sender or not topic:
            return False
        found = self._participants(topic, participant(sender))
        if not found or participant(sender) in found:
            return False
        if len(self._foreign) < _MOST:
            self._foreign.add((event, sender))
        return True

    def _participants(self, topic, sender):
        """Return the participants that may speak, after a look at the graph if `sender` is not among them."""
        entry, now = self._of(topic), monotonic()
        if sender not in entry.publisher.participants() and now >= entry.look_at:
            entry.look_at = now + _LOOK_EVERY
            entry.publisher.look()
        return entry.publisher.participants()

    def _of(self, topic):
        if topic not in self._publishers:
            if len(self._publishers) >= _MOST:
                kept = {known: self._publishers[known] for known in self._regular if known in self._publishers}
                self._publishers = kept
            self._publishers[topic] = _Entry(OnePublisher(self._node, topic, besides=_BESIDES.get(topic)))
        return self._publishers[topic]

    def _look(self):
        """Look the regular topics up: every second, and at each call while their publisher is unknown."""
        now = monotonic()
        is_due = now >= self._all_at
        if is_due:
            self._all_at = now + _LOOK_REGULARLY
            self._foreign.clear()
        for topic in self._regular:
            publisher = self._of(topic).publisher
            if is_due or not publisher.gid:
                publisher.look()
