"""Subscriptions of the servo tick."""

from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.one_publisher import OnePublisher

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'  # header of plain CDR
# [s, wall] between two looks at the graph because of messages of an unknown sender
_LOOK_EVERY = 0.05
# [s, wall] between two looks while no publisher is known
_LOOK_REGULARLY = 0.5


class TickSubscription:
    """
    A subscription of the servo tick to serialized messages of a fixed size, from one publisher.

    The lock-step executor takes messages of the `OnePublisher` of the topic only. rclpy's public API does not know the
    sender of a message: there every sender counts.

    Parameters
    ----------
    node : PkmNode
    message_type
        Type of its messages.
    topic : str
    callback : callable
        ``callback(data)`` with the bytes of a message.
    qos : QoSProfile
    size : int
        [bytes] of a serialized message. A message of another size or byte order is counted and dropped.

    Attributes
    ----------
    topic_name : str
        Resolved name.
    size : int
        [bytes]
    served : tuple of callable
        Called with every message, in this order.
    publisher : OnePublisher
        Whose messages are taken.
    refused, foreign : int
        Number of messages that were dropped because of their form, and because of their sender.

    """

    def __init__(self, node, message_type, topic, callback, qos, *, size):
        self._node, self.size, self.served = node, size, (callback,)
        self.refused, self.foreign, self._look_at = 0, 0, 0.0
        self._take = None  # the `TickTake` of the lock-step executor
        self._warn = LogThrottle(node.get_logger())
        self.publisher = OnePublisher(node, topic)
        self._subscription = node.create_subscription(
            message_type, topic, self._check, qos, callback_group=node.hot_group, raw=True
        )
        node.hot_group.subscriptions[self._subscription] = self
        self.topic_name = self._subscription.topic_name
        # the publisher is known before the first message, when others may come at the same time
        node.create_timer(_LOOK_REGULARLY, self._bind_early, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def tap(self, callback):
        """Call `callback(data)` with every message from now on, before the subscription's own callback."""
        self.served = (callback, *self.served)
        if self._node.executor is not None:  # the executor looks callbacks up in advance
            self._node.executor.wake()

    def bind(self):
        """Take messages of the one publisher of the topic; return whether the graph has at most one."""
        alone = self.publisher.look()
        if self._take is not None:
            self._take.expect(self.publisher.gid)
        return alone

    def _bind_early(self):
        if not self.publisher.gid:
            self.bind()

    def take_by(self, take):
        """Let the lock-step executor take by `take`, a `TickTake`."""
        self._take = take
        take.expect(self.publisher.gid)

    def on_stranger(self):
        """Serve the message just taken if its sender is, or now becomes, the one publisher; drop it otherwise."""
        take, now = self._take, monotonic()
        if now >= self._look_at:
            self._look_at = now + _LOOK_EVERY
            self.bind()
        if self.publisher.gid in (b'', take.sender):
            self._serve(take.content.tobytes())
            return
        self.foreign += 1
        names = ', '.join(self.publisher.others) or 'a node that the graph does not list'
        self._warn(f'{self.topic_name}: message dropped, its sender is not the first publisher; others: {names}')

    def on_malformed(self):
        """Drop the message just taken."""
        self._refuse(self._take.malformed)

    def _serve(self, data):
        for callback in self.served:
            callback(data)

    def _check(self, data):
        """Take a message from an executor of rclpy."""
        if len(data) == self.size and data[:4] == _LITTLE_ENDIAN:
            self._serve(data)
        else:
            self._refuse(data)

    def _refuse(self, data):
        self.refused += 1
        self._warn(
            f'{self.topic_name}: message of {len(data)} bytes with header {bytes(data[:4]).hex()} dropped; '
            f'expected {self.size} bytes, header {_LITTLE_ENDIAN.hex()} (little-endian CDR)'
        )

    def get_publisher_count(self):
        """Return the number of connected publishers."""
        return self._subscription.get_publisher_count()
