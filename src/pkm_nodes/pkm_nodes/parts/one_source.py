"""Subscriptions outside the servo tick that compare the sender of a message with the one it must have."""

from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.serialization import deserialize_message

from pkm_interfaces.msg import SampledTrajectory
from pkm_nodes.runtime.groups import SenderGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.node import CYCLE_QOS
from pkm_nodes.runtime.one_publisher import OnePublisher, node_name

# [s, wall] between two looks at the graph because of messages of an unknown sender, and while no publisher is known
_LOOK_EVERY, _LOOK_REGULARLY = 0.05, 0.5


def subscribe_one(node, message_type, topic, callback, qos, *, besides=None):
    """
    Call `callback(message)` with the messages that the `OnePublisher` of `topic` accepts; others are dropped.

    rclpy's public API does not know the sender of a message: there every sender counts. Return the `OnePublisher`.
    """
    warn = LogThrottle(node.get_logger())

    look_at = 0.0  # [s, wall] of the next look because of an unknown sender

    def on_message(data, sender=b''):
        nonlocal look_at
        if sender and sender != publisher.gid and (now := monotonic()) >= look_at:
            look_at = now + _LOOK_EVERY
            publisher.look()
        if not publisher.accepts(sender):
            warn(
                f'{publisher.topic}: message dropped, its sender is not the first publisher; others: {publisher.others}'
            )
            return
        try:
            message = deserialize_message(data, message_type)
        except (RuntimeError, ValueError, OverflowError) as error:
            warn(f'{publisher.topic}: message of {len(data)} bytes dropped: {error}')
            return
        callback(message)

    def look_early():  # the publisher is known before others come
        if not publisher.gid:
            publisher.look()

    publisher = OnePublisher(node, topic, besides=besides)
    node.create_timer(_LOOK_REGULARLY, look_early, clock=Clock(clock_type=ClockType.STEADY_TIME))
    node.create_subscription(message_type, topic, on_message, qos, callback_group=SenderGroup(), raw=True)
    return publisher


def subscribe_joint_trajectory(node, callback):
    """
    Call `callback` with joint_trajectory of one publisher besides the node that publishes pose_trajectory.

    Return the `OnePublisher`.
    """
    kind, besides = SampledTrajectory, 'pose_trajectory'
    return subscribe_one(node, kind, 'joint_trajectory', callback, CYCLE_QOS, besides=besides)


def subscribe_own(node, message_type, topic, callback, qos, named):
    """
    Call `callback(message)` for messages on `topic`, to which many nodes publish, from the node that the message names.

    `named(message)` returns the full name of that node. rclpy's public API does not know the sender of a message: there
    only the name counts.
    """
    warn, resolved, known = LogThrottle(node.get_logger()), node.resolve_topic_name(topic), {}
    look_at = 0.0

    def on_message(data, sender=b''):
        nonlocal look_at
        if sender and sender not in known and (now := monotonic()) >= look_at:
            look_at = now + _LOOK_EVERY
            infos = node.get_publishers_info_by_topic(resolved)
            known.clear()
            # a node that has just started sends before its name is known
            infos = [info for info in infos if not info.node_name.startswith('_')]
            known.update({bytes(info.endpoint_gid): node_name(info) for info in infos})
        try:
            message = deserialize_message(data, message_type)
        except (RuntimeError, ValueError, OverflowError) as error:
            warn(f'{resolved}: message of {len(data)} bytes dropped: {error}')
            return
        if (of := known.get(sender, named(message))) != named(message):
            warn(f'{resolved}: message about {named(message)[:80]} dropped: it is of {of}')
            return
        callback(message)

    return node.create_subscription(message_type, topic, on_message, qos, callback_group=SenderGroup(), raw=True)
