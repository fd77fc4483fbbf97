"""Compares the sender of a cycle event with the node that the event names."""

import re
from dataclasses import dataclass
from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.servo.event_sources import FIRST, MACHINE, topics_of
from pkm_nodes.runtime.discovery import knows_whole_graph
from pkm_nodes.runtime.one_publisher import OnePublisher, participant

# [s, wall] between two looks at the graph because of an unknown sender: a flood of events costs no more
_LOOK_EVERY = 0.05
# [s, wall] the same for sources that are not looked up regularly: a flood may name another source in every event
_LOOK_OTHERS_EVERY = 0.005
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
    recorder, trajectory sources and `joints` are looked up regularly, those of other sources with their first event. A
    source that publishes on none of its topics is not in the graph, and nothing is believed of it, except behind a
    discovery server: there a node does not know the publishers of topics that it does not subscribe to.
    """

    def __init__(self, node, joints=()):
        self._node = node
        self._publishers = {}  # by topic
        self._look_others_at = 0.0
        self._regular = [*FIRST, *(f'{joint}/command' for joint in joints)]
        self._machines = MachineProcesses(node)
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._all_at = 0.0  # [s, wall] time of the next look at all of them
        node.create_timer(_LOOK_FOR_FIRST, self._look_regularly, clock=wall)  # known before others come

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
        now, process = monotonic(), participant(sender)
        found = [self._participants(each, process, now) for each in topics]
        return any(process in each for each in found) or not (any(found) or knows_whole_graph())

    def look(self):
        """Look all known topics up."""
        for entry in self._publishers.values():
            entry.publisher.look()

    def _participants(self, topic, sender, now):
        """Return the participants that may speak, after a look at the graph if `sender` is not among them."""
        entry = self._of(topic)
        if sender not in entry.publisher.participants() and now >= entry.look_at and self._may_look(topic, now):
            entry.look_at = now + _LOOK_EVERY
            entry.publisher.look()
        found = entry.publisher.participants()
        return self._machines.participants(sender) if topic == MACHINE and not found else found

    def _may_look(self, topic, now):
        if topic in self._regular:
            return True
        if now < self._look_others_at:
            return False
        self._look_others_at = now + _LOOK_OTHERS_EVERY
        return True

    def _of(self, topic):
        if topic not in self._publishers:
            if len(self._publishers) >= _MOST:
                kept = {known: self._publishers[known] for known in self._regular if known in self._publishers}
                self._publishers = kept
            self._publishers[topic] = _Entry(OnePublisher(self._node, topic, besides=_BESIDES.get(topic)))
        return self._publishers[topic]

    def _look_regularly(self):
        """Look the regular topics up: every second, and at each call while their publisher is unknown."""
        now = monotonic()
        is_due = now >= self._all_at
        if is_due:
            self._all_at = now + _LOOK_REGULARLY
        for topic in self._regular:
            publisher = self._of(topic).publisher
            if is_due or not publisher.gid:
                publisher.look()


class MachineProcesses:
    """
    The processes that publish encoder samples in the namespace of `node`.

    A machine of the user's own need not publish machine/cycle: then it is recognised by its encoders.
    """

    def __init__(self, node):
        self._node, self._found, self._look_at = node, set(), 0.0
        self._encoder = re.compile(re.escape(node.get_namespace().rstrip('/')) + r'/\w+/encoder')

    def participants(self, sender):
        """Return them, after a look at the graph if the participant `sender` is not among them."""
        now = monotonic()
        if sender not in self._found and now >= self._look_at:
            self._look_at = now + _LOOK_EVERY
            topics = [name for name, _ in self._node.get_topic_names_and_types() if self._encoder.fullmatch(name)]
            infos = [info for topic in topics for info in self._node.get_publishers_info_by_topic(topic)]
            self._found = {participant(bytes(info.endpoint_gid)) for info in infos}
        return self._found
