"""
The links of a machine as transforms.

Package tf2_msgs is not among the wheels that the project is set up from. In a ROS installation, which has it, the
transforms are one tf2_msgs/TFMessage per state; otherwise one geometry_msgs/TransformStamped per link.
"""

import importlib

import numpy as np
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from std_msgs.msg import Header

from pkm_core.machines.transforms import LinkTransforms, transform
from pkm_nodes.messages.template import DOUBLE, STAMP, Template

_GAPS = Transform(
    translation=Vector3(x=DOUBLE, y=DOUBLE, z=DOUBLE), rotation=Quaternion(x=DOUBLE, y=DOUBLE, z=DOUBLE, w=DOUBLE)
)


def find_tf_message():
    """Return the class TFMessage of package tf2_msgs, None where it is not installed."""
    try:
        return importlib.import_module('tf2_msgs.msg').TFMessage
    except ImportError:
        return None


class TransformMessages:
    """
    Makes the messages of the links of `machine`.

    Parameters
    ----------
    machine : Machine
    prefix : str
        Of every frame, see `pkm_nodes.graph.frame_prefix_of`.
    tf_message : type or None
        From `find_tf_message`: whether a message has all transforms or one.

    """

    def __init__(self, machine, prefix, tf_message):
        self._links, self._prefix, self._tf_message = LinkTransforms(machine), prefix, tf_message
        stamped = [self._stamped(link, STAMP, _GAPS) for link in self._links.moving]
        messages = stamped if tf_message is None else [tf_message(transforms=stamped)]
        self._templates = [Template(message) for message in messages]

    def moving(self, nanoseconds, positions):
        """Return the serialized messages of a time [ns] and `positions` of `joint_positions`."""
        numbers = self._links.at(positions)
        parts = np.split(numbers, len(self._templates))
        return [template.filled(part, nanoseconds) for template, part in zip(self._templates, parts, strict=True)]

    def fixed(self):
        """Return the messages of the links that do not move in their parent; their time is 0, valid always."""
        stamped = []
        for link in self._links.fixed:
            x, y, z, *turn = transform(link, {}).tolist()
            rotation = Quaternion(**dict(zip('xyzw', turn, strict=True)))
            stamped.append(self._stamped(link, None, Transform(translation=Vector3(x=x, y=y, z=z), rotation=rotation)))
        return stamped if self._tf_message is None else [self._tf_message(transforms=stamped)]

    def _stamped(self, link, stamp, value):
        header = Header(frame_id=self._prefix + link.parent)
        if stamp is not None:
            header.stamp = stamp
        return TransformStamped(header=header, child_frame_id=self._prefix + link.name, transform=value)
