"""A subscription outside the servo tick that takes the messages of one publisher only."""

from rclpy.serialization import deserialize_message

from pkm_nodes.runtime.groups import SenderGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.one_publisher import OnePublisher


def subscribe_one(node, message_type, topic, callback, qos):
    """
    Call `callback(message)` with the messages of the `OnePublisher` of `topic`; others are dropped with a log line.

    rclpy's public API does not know the sender of a message: there every sender counts.
    """
    warn = LogThrottle(node.get_logger().warn)

    def on_message(data, sender=b''):
        if sender and sender != publisher.gid:
            publisher.look()
        if sender and publisher.gid not in (b'', sender):
            warn(
                f'{publisher.topic}: message dropped, its sender is not the first publisher; others: {publisher.others}'
            )
            return
        try:
            message = deserialize_message(data, message_type)
        except RuntimeError as error:
            warn(f'{publisher.topic}: message of {len(data)} bytes dropped: {error}')
            return
        callback(message)

    publisher = OnePublisher(node, topic)
    return node.create_subscription(message_type, topic, on_message, qos, callback_group=SenderGroup(), raw=True)
