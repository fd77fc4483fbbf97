"""Compares the sender of a cycle event with the node that the event names."""

from time import monotonic

from pkm_core.servo.event_sources import topics_of
from pkm_nodes.runtime.one_publisher import OnePublisher, participant

# [s, wall] between two looks at the graph because of an unknown sender: a flood of events costs no more
_LOOK_EVERY = 0.05
# topics that are remembered; a forged source can name any
_MOST = 50


class Speakers:
    """
    The publishers by which `node` recognises the sources of cycle events.

    Machine and recorder are the nodes whose publisher was the first on their topic. For other sources any publisher of
    the topic counts: the machine starts no cycle while there are several.
    """

    def __init__(self, node):
        self._node = node
        self._publishers = {}  # OnePublisher and the time of the next look [s, wall], by topic

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
        strict = source in ('machine', 'recorder')
        found = [self._participants(topic, participant(sender), strict) for topic in topics]
        # a topic without a publisher identifies no node: a machine of the user's own need not publish machine/cycle
        return participant(sender) in set().union(*found) or not any(found)

    def _participants(self, topic, sender, strict):
        """Return the participants that may speak, after a look at the graph if `sender` is not among them."""
        if topic not in self._publishers:
            if len(self._publishers) >= _MOST:
                self._publishers.clear()
            self._publishers[topic] = [OnePublisher(self._node, topic), 0.0]
        publisher, look_at = self._publishers[topic]
        now = monotonic()
        if sender not in publisher.participants(strict) and now >= look_at:
            self._publishers[topic][1] = now + _LOOK_EVERY
            publisher.look()
        return publisher.participants(strict)
