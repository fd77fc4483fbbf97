"""A subscription outside the servo tick that takes the messages of one publisher only."""

from rclpy.serialization import deserialize_message

from pkm_interfaces.msg import SampledTrajectory
from pkm_nodes.runtime.groups import SenderGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CYCLE_QOS
from pkm_nodes.runtime.one_publisher import OnePublisher


def subscribe_one(node, message_type, topic, callback, qos, *, besides=None):
    """
    Call `callback(message)` with the messages that the `OnePublisher` of `topic` accepts; others are dropped.

    rclpy's public API does not know the sender of a message: there every sender counts.
    """
    warn = LogThrottle(node.get_logger())

    def on_message(data, sender=b''):
        if sender and sender != publisher.gid:
            publisher.look()
        if not publisher.accepts(sender):
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

    publisher = OnePublisher(node, topic, besides=besides)
    return node.create_subscription(message_type, topic, on_message, qos, callback_group=SenderGroup(), raw=True)


def subscribe_joint_trajectory(node, callback):
    """Call `callback` with joint_trajectory of one publisher besides the node that publishes pose_trajectory."""
    kind, besides = SampledTrajectory, 'pose_trajectory'
    return subscribe_one(node, kind, 'joint_trajectory', callback, CYCLE_QOS, besides=besides)
