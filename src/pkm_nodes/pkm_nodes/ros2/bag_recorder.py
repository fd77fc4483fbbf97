"""The recorder of `ros2 bag record`."""

import re
import sys
import time
from collections import Counter

import rclpy
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rosbags.typesys import get_types_from_msg

from pkm_core.bag.message_types import typestore
from pkm_core.bag.rosbag2 import Qos
from pkm_core.errors import BagError
from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.ros2.interface import text_of
from pkm_nodes.ros2.qos import match_publishers
from pkm_nodes.ros2.shared import spin_until_done
from pkm_nodes.runtime.discovery import DISCOVERY_TIME

# [messages] of a topic that wait in this process; the writing of a chunk takes a few ms
_DEPTH = 10_000


def _say(text):
    print(f'[INFO] [{time.time():.9f}] [rosbag2_recorder]: {text}', file=sys.stderr, flush=True)


class Recorder:
    """
    Records topics of the graph of `node` with `writer`, as the arguments of the command line ask.

    A lost message is a gap in the numbers that the middleware gives to the messages of a publisher. rclpy does not name
    the publisher of a message: the loss of a topic is known while it has one publisher.
    """

    def __init__(self, node, writer, args):
        self._node, self._writer, self._args = node, writer, args
        self._types = typestore()
        self._subscriptions, self._refused = {}, set()  # by topic
        self._first, self._last, self._received = {}, {}, Counter()  # numbers of messages by topic
        self._uncounted = set()  # topics with several publishers
        self._begun = time.monotonic()

    def run(self):
        """Record until a signal raises `Interrupted`."""
        _say('Listening for topics...')
        self._look()
        if not self._args.no_discovery:
            self._node.create_timer(self._args.polling_interval * 1e-3, self._look)
        elif not self._subscriptions:
            time.sleep(DISCOVERY_TIME)
            self._look()
        _say('Recording... (Ctrl-C closes the bag)')
        spin_until_done(self._node, rclpy.Future())

    def close(self):
        """Finish the bag and print its numbers; the exit code of the command stays 0, as that of rosbag2."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._writer.close({})
        lost = {topic: loss for topic in self._subscriptions if (loss := self._loss(topic))}
        for topic, loss in sorted(lost.items()):
            _say(f'{topic}: {loss} message(s) lost')
        for topic in sorted(self._uncounted):
            _say(f'{topic}: several publishers; lost messages cannot be counted')
        for topic in sorted(set(self._args.topics) - set(self._subscriptions)):
            _say(f'{topic}: was not published')
        total = sum(self._writer.counts.values())
        amount = f'{total} message(s) of {len(self._subscriptions)} topic(s)'
        _say(f'{amount} in {self._writer.path}; {sum(lost.values())} lost')

    def _loss(self, topic):
        if topic in self._uncounted or topic not in self._first:
            return 0
        return max(0, self._last[topic] - self._first[topic] + 1 - self._received[topic])

    def _look(self):
        """Subscribe to the topics that are asked for and not yet recorded."""
        for topic, kinds in self._node.get_topic_names_and_types():
            publishers = self._node.get_publishers_info_by_topic(topic)
            if topic in self._subscriptions and len(publishers) > 1:
                self._uncounted.add(topic)
            if topic in self._subscriptions or topic in self._refused or not publishers or not self._is_asked(topic):
                continue
            try:
                if len(kinds) > 1:
                    raise BagError(f'more than one type: {", ".join(kinds)}')
                self._subscribe(topic, kinds[0], publishers)
            except (BagError, RuntimeError) as error:
                self._refused.add(topic)
                _say(f"Topic '{topic}' is not recorded: {error}")
        if self._args.max_bag_duration and time.monotonic() - self._begun > self._args.max_bag_duration:
            self._begun = time.monotonic()
            self._writer.split()

    def _is_asked(self, topic):
        args = self._args
        if topic in args.topics:
            return True
        hidden = any(part.startswith('_') for part in topic.split('/'))
        excluded = args.exclude_regex is not None and args.exclude_regex.search(topic)
        if (hidden and not args.include_hidden_topics) or excluded:
            return False
        return args.all or bool(args.regex and args.regex.search(topic))

    def _subscribe(self, topic, kind, publishers):
        define(self._types, kind)
        profile = match_publishers(QoSProfile(depth=_DEPTH), publishers)
        reliable = profile.reliability == QoSReliabilityPolicy.RELIABLE
        latched = profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
        offered = Qos('reliable' if reliable else 'best_effort', 'transient_local' if latched else 'volatile')
        self._writer.add_topic(topic, kind, self._types, offered)
        clock = self._node.get_clock()

        def on_message(data, info):
            now, sequence = clock.now().nanoseconds, info['publication_sequence_number']
            if sequence is not None:
                self._first.setdefault(topic, sequence)
                self._last[topic] = sequence
            self._received[topic] += 1
            self._writer.write(topic, data, now)

        self._subscriptions[topic] = self._node.create_subscription(
            find_interface(kind, 'msg'), topic, on_message, profile, raw=True
        )
        _say(f"Subscribed to topic '{topic}'")


def define(types, kind):
    """
    Add the definition of the message type `kind` to the typestore `types`, with those of the messages in it.

    Raises
    ------
    BagError
        If no installed package has the definition.

    """
    if kind in types.fielddefs:
        return
    try:
        found = get_types_from_msg(text_of(kind), kind)
    except RuntimeError as error:
        raise BagError(f'{error}; a bag needs the definition of {kind}') from None
    for _, fields in found.values():
        for name in re.findall(r"'([A-Za-z]\w*/msg/\w+)'", repr(fields)):
            define(types, name)
    types.register({name: fields for name, fields in found.items() if name not in types.fielddefs})
