"""Raw subscriptions of a recorder, taken many messages at a time, from one publisher or with their senders."""

from time import monotonic

import numpy as np

from pkm_nodes.runtime.one_publisher import OnePublisher

# [s, wall] between two looks at the graph because of messages of an unknown sender
_LOOK_EVERY = 0.05


class PatientSubscription:
    """
    A subscription in a `PatientGroup` that drops the messages of all publishers of `topic` but one.

    Parameters
    ----------
    node : PkmNode
    message_type
    topic : str
    take : callable
        Takes one serialized message, or several as the rows of an (n, size) array of bytes.
    qos : QoSProfile
    group : PatientGroup
    besides : str, optional
        See `OnePublisher`.

    Attributes
    ----------
    foreign : int
        Number of messages that were dropped.

    """

    def __init__(self, node, message_type, topic, take, qos, group, *, besides=None):
        self._take, self._publisher, self._look_at = take, OnePublisher(node, topic, besides=besides), 0.0
        self.foreign = 0
        self._subscription = node.create_subscription(
            message_type, topic, self._on_messages, qos, callback_group=group, raw=True
        )

    @property
    def topic_name(self):
        """Resolved name."""
        return self._publisher.topic

    @property
    def others(self):
        """Nodes whose messages are dropped, see `OnePublisher`."""
        return self._publisher.others

    def look(self):
        """Read the graph, regularly: the publisher is known before its first message."""
        self._publisher.look()

    def get_publisher_count(self):
        """Return the number of connected publishers."""
        return self._subscription.get_publisher_count()

    def _on_messages(self, messages, senders=None):
        if senders is not None:  # rclpy's API names no sender
            ours = self._are_ours(senders)
            self.foreign += len(ours) - int(ours.sum())
            if not ours.all():
                messages = messages[ours]
        if len(messages):
            self._take(messages)

    def _are_ours(self, senders):
        """Return for each of the GIDs (n, 2) whether its messages are taken."""
        ours, now = self._match(senders), monotonic()
        if not ours.all() and now >= self._look_at:
            self._look_at = now + _LOOK_EVERY
            self._publisher.look()
            ours = self._match(senders)
        for i in np.flatnonzero(~ours):
            ours[i] = self._publisher.accepts(senders[i].tobytes())
        return ours

    def _match(self, senders):
        if not self._publisher.gid:
            return np.zeros(len(senders), bool)
        return (senders == np.frombuffer(self._publisher.gid, np.int64)).all(axis=1)
