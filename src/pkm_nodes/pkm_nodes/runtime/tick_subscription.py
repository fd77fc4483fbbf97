"""Subscriptions of the servo tick."""


class TickSubscription:
    """
    A subscription of the servo tick.

    Parameters
    ----------
    node : PkmNode
    message_type
        Type of its messages.
    topic : str
    callback : callable
        ``callback(message)``.
    qos : QoSProfile
    raw : bool
        Whether messages are serialized, as bytes.

    Attributes
    ----------
    topic_name : str
        Resolved name.
    raw : bool

    """

    def __init__(self, node, message_type, topic, callback, qos, *, raw):
        self._node = node
        self._subscription = node.create_subscription(
            message_type, topic, callback, qos, callback_group=node.hot_group, raw=raw
        )
        self.topic_name, self.raw = self._subscription.topic_name, raw

    def tap(self, callback):
        """Call `callback(message)` with every message from now on, before the subscription's own callback."""
        served = self._subscription.callback

        def serve_both(message):
            callback(message)
            served(message)

        self._subscription.callback = serve_both
        if self._node.executor is not None:  # the executor looks callbacks up in advance
            self._node.executor.wake()

    def get_publisher_count(self):
        """Return the number of connected publishers."""
        return self._subscription.get_publisher_count()
