"""Subscriptions of the servo tick."""

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'  # header of plain CDR


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
    size : int or None
        [bytes] of the serialized messages that the callback takes. A message of another size or byte order is
        counted and dropped. None: the callback takes message objects.

    Attributes
    ----------
    topic_name : str
        Resolved name.
    raw : bool
    refused : int
        Number of messages that were dropped.

    """

    def __init__(self, node, message_type, topic, callback, qos, *, size):
        self._node, self._size, self._serve = node, size, callback
        self.raw, self.refused = size is not None, 0
        self._subscription = node.create_subscription(
            message_type, topic, self._checked(callback), qos, callback_group=node.hot_group, raw=self.raw
        )
        self.topic_name = self._subscription.topic_name

    def tap(self, callback):
        """Call `callback(message)` with every message from now on, before the subscription's own callback."""
        served = self._serve

        def serve_both(message):
            callback(message)
            served(message)

        self._serve = serve_both
        self._subscription.callback = self._checked(served, callback)
        if self._node.executor is not None:  # the executor looks callbacks up in advance
            self._node.executor.wake()

    def _checked(self, serve, tap=None):
        """Return a callback that passes messages of the right size and byte order to `tap`, if any, then `serve`."""
        size = self._size
        if size is None:
            return self._serve

        def take(data):
            if len(data) == size and data[:4] == _LITTLE_ENDIAN:
                serve(data)
            else:
                self._refuse(data)

        def take_both(data):  # saves one call per message over take with serve_both
            if len(data) == size and data[:4] == _LITTLE_ENDIAN:
                tap(data)
                serve(data)
            else:
                self._refuse(data)

        return take if tap is None else take_both

    def _refuse(self, data):
        self.refused += 1
        if self.refused == 1:  # one line per topic; the number of them is in the diagnostics
            self._node.get_logger().warn(
                f'{self.topic_name}: message of {len(data)} bytes with header {bytes(data[:4]).hex()} dropped; '
                f'expected {self._size} bytes, header {_LITTLE_ENDIAN.hex()} (little-endian CDR)'
            )

    def get_publisher_count(self):
        """Return the number of connected publishers."""
        return self._subscription.get_publisher_count()
