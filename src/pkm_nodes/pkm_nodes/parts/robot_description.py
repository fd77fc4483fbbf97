"""The URDF of a machine and the transforms of its links, as tools of ROS expect them."""

from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from pkm_core.machines.urdf import urdf
from pkm_nodes.messages.transforms import TransformMessages, find_tf_message
from pkm_nodes.runtime.node import CYCLE_QOS, LAST_VALUE_QOS

# [ticks] period of the transforms as one message per link, 20 Hz of simulated time: each costs as much as a pose
SINGLE_EVERY = 100
# the last value of every link, or of all
_STATIC_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class RobotDescription:
    """
    Publishes robot_description and transforms for `node`.

    robot_description and the transforms that do not change are published by `take`, and last. The others are published
    while they have a subscriber.

    Parameters
    ----------
    node : PkmNode
    prefix : str
        Of every frame of the transforms; the links of the URDF have none, as for robot_state_publisher.

    """

    def __init__(self, node, prefix):
        self._prefix, self._tf_message = prefix, find_tf_message()
        single = self._tf_message is None
        kind, moving, fixed = (
            (TransformStamped, 'transforms', 'transforms_static') if single else (self._tf_message, '/tf', '/tf_static')
        )
        self._every = SINGLE_EVERY if single else 1
        self._text = node.create_publisher(String, 'robot_description', LAST_VALUE_QOS)
        self._fixed = node.create_publisher(kind, fixed, _STATIC_QOS)
        self._moving = node.create_publisher(kind, moving, CYCLE_QOS)
        self._messages = None
        self._resting = (None, 0)  # time [ns] and subscribers of the last transforms of a machine that stands

    def take(self, machine):
        """Describe `machine` from now on."""
        self._messages = TransformMessages(machine, self._prefix, self._tf_message)
        self._resting = (None, 0)
        self._text.publish(String(data=urdf(machine)))
        for message in self._messages.fixed():
            self._fixed.publish(message)

    def move(self, tick, nanoseconds, positions):
        """Publish the transforms at `positions` of `joint_positions`, the state of `tick`."""
        if tick % self._every == 0 and self._moving.get_subscription_count():
            self._publish(nanoseconds, positions)

    def rest(self, nanoseconds, positions):
        """
        Publish the transforms of a machine that stands, if they are new or have a new subscriber.

        Transforms with one time must not be repeated: buffers of tf2 keep every copy.
        """
        subscribers = self._moving.get_subscription_count()
        before, self._resting = self._resting, (nanoseconds, subscribers)
        if subscribers and (nanoseconds != before[0] or subscribers > before[1]):
            self._publish(nanoseconds, positions)

    def _publish(self, nanoseconds, positions):
        for message in self._messages.moving(nanoseconds, positions):
            self._moving.publish(message)
