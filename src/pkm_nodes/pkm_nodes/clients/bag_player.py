"""Replays recorded messages: the same bytes at the recorded times, with /clock."""

from time import monotonic, sleep

from rclpy.duration import Duration
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock

from pkm_core.errors import BagError, PkmError
from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.runtime.discovery import DISCOVERY_TIME, wait_for
from pkm_nodes.runtime.node import TICK_QOS

# [ns] period of /clock in simulated time, as the machine publishes it
_CLOCK_PERIOD = 10_000_000
# [s, wall] until all known subscriptions are connected: milliseconds, unless a subscriber is ending
_CONNECTED_TIMEOUT = 10.0
# [s, wall] for the subscribers to acknowledge the last messages
_DELIVERED_TIMEOUT = 10.0


class BagPlayer:
    """
    Publishes messages into the graph of `node`; topics with another publisher are left to that publisher.

    Parameters
    ----------
    node : rclpy.node.Node
        Owns the publishers.
    messages : list of (str, str, bytes, int)
        Topic, type, serialized message and time [ns], oldest first.

    Attributes
    ----------
    left_out : dict of str to list of str
        Publishing nodes by topic that is not replayed.
    publishers : dict of str to Publisher
        By topic that is replayed.

    Raises
    ------
    PkmError
        If a cell runs in the graph, no topic is left to replay, or a type is not installed.

    """

    def __init__(self, node, messages):
        kinds = {topic: kind for topic, kind, _, _ in messages}
        sleep(DISCOVERY_TIME)
        owners = {topic: _publishers_of(node, topic) for topic in ('/clock', *kinds)}
        clocks = [topic for topic in owners if owners[topic] and (topic == '/clock' or topic.endswith('/encoder'))]
        if clocks:
            raise PkmError(
                f'{clocks[0]}: published by {owners[clocks[0]]}: a cell is running; '
                'stop it or set another ROS_DOMAIN_ID'
            )
        self.left_out = {topic: owners[topic] for topic in kinds if owners[topic]}
        self._messages = [message for message in messages if message[0] not in self.left_out]
        if not self._messages:
            raise PkmError(f'every topic of the bag has another publisher: {self.left_out}')
        self._clock = node.create_publisher(Clock, '/clock', qos_profile_sensor_data)
        self.publishers = {
            topic: node.create_publisher(_message_class(topic, kind), topic, TICK_QOS)
            for topic, kind in kinds.items()
            if topic not in self.left_out
        }
        wait_for(
            lambda: all(p.get_subscription_count() >= node.count_subscribers(t) for t, p in self.publishers.items()),
            _CONNECTED_TIMEOUT,
        )

    def play(self, rate):
        """Publish all messages once, at `rate` simulated seconds per second; return the duration [s, wall]."""
        begin, origin = monotonic(), self._messages[0][3]
        clock_due = origin
        for topic, _, data, time in self._messages:
            ahead = (time - origin) * 1e-9 / rate - (monotonic() - begin)
            if ahead > 0:
                sleep(ahead)
            if time >= clock_due:
                self._publish_clock(time)
                clock_due = time - time % _CLOCK_PERIOD + _CLOCK_PERIOD
            self.publishers[topic].publish(data)
        for publisher in self.publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=_DELIVERED_TIMEOUT))
        return monotonic() - begin

    def _publish_clock(self, nanoseconds):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(nanoseconds, 1_000_000_000)
        self._clock.publish(message)


def _publishers_of(node, topic):
    """Return the names of the nodes that publish `topic`."""
    endpoints = node.get_publishers_info_by_topic(topic)
    return sorted({f'{e.node_namespace.rstrip("/")}/{e.node_name}' for e in endpoints})


def _message_class(topic, kind):
    try:
        return find_interface(kind, 'msg')
    except RuntimeError:
        raise BagError(f'{topic}: has type {kind}, which is not installed') from None
