"""A filled template equals the message with these numbers; padding bytes may have any value."""

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from pkm_core.bag.message_types import typestore
from pkm_interfaces.msg import LaserSample
from pkm_nodes.messages.template import DOUBLE, POSE, STAMP, Template

NANOSECONDS = 12_000_000_345


def joint_states(stamp, numbers):
    """Return names of odd lengths before the numbers and empty sequences after them."""
    return JointState(header=Header(stamp=stamp), name=['d1', 'theta10', 'x'], position=numbers)


def markers(stamp, numbers):
    poses = [
        Pose(
            position=Point(**dict(zip('xyz', numbers[i : i + 3], strict=True))),
            orientation=Quaternion(**dict(zip('xyzw', numbers[i + 3 : i + 7], strict=True))),
        )
        for i in range(0, len(numbers), 7)
    ]
    return MarkerArray(
        markers=[
            Marker(header=Header(stamp=stamp, frame_id=name), ns=name, id=-1, pose=pose, color=ColorRGBA(a=1.0))
            for name, pose in zip(('base', 'a', 'platform_q'), poses, strict=True)
        ]
    )


def laser(_, numbers):
    return LaserSample(time=numbers[0], displacement=numbers[1:])


CASES = [
    (joint_states, 3, 'sensor_msgs/msg/JointState'),
    (markers, 21, 'visualization_msgs/msg/MarkerArray'),
    (laser, 5, 'pkm_interfaces/msg/LaserSample'),
]


@pytest.mark.parametrize(('make', 'count', 'kind'), CASES)
def test_filled_template_is_the_message_each_time(make, count, kind):
    template = Template(make(STAMP, count * [DOUBLE]))
    for scale in (-1e-3, 1e300, float('inf')):
        numbers = [scale * (1 + i) for i in range(count)]
        message = make(Time(sec=12, nanosec=345), numbers)
        data = template.filled(numbers, NANOSECONDS)
        assert deserialize_message(data, type(message)) == message
        typestore().deserialize_cdr(data, kind)  # refuses trailing bytes, which serialize_message of rclpy adds


def test_wrong_number_of_values_is_refused():
    template = Template(PoseStamped(pose=POSE))
    with pytest.raises(ValueError, match='6'):
        template.filled(6 * [0.0])
