"""The links of a machine as visualization_msgs/MarkerArray, for tools that take no URDF."""

from geometry_msgs.msg import Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from pkm_core.machines.description import ROOT, base_boxes, frames, links, moved
from pkm_nodes.messages.template import POSE, STAMP, Template


class LinkMarkers:
    """Makes one CUBE marker per box of `pkm_core.machines.description`, in the base frame, whose name has `prefix`."""

    def __init__(self, machine, prefix=''):
        self._links = links(machine)
        boxes = {ROOT: base_boxes(machine)} | {link.name: link.boxes for link in self._links}
        self._boxes = [(name, number, box) for name, of_link in boxes.items() for number, box in enumerate(of_link)]
        self._template = Template(MarkerArray(markers=[_marker(prefix + ROOT, *box) for box in self._boxes]))

    def message(self, nanoseconds, positions):
        """Return the serialized MarkerArray, in the base frame, of a time [ns] and `positions` of `joint_positions`."""
        found = frames(self._links, positions)
        numbers = []
        for name, _, box in self._boxes:
            turn, origin = found[name]
            numbers += (*moved(turn, origin, box.centre), *turn[1:], turn[0])
        return self._template.filled(numbers, nanoseconds)


def _marker(frame, name, number, box):
    """Return the marker of a box with gaps for stamp and pose."""
    red, green, blue = box.colour
    return Marker(
        header=Header(stamp=STAMP, frame_id=frame),
        ns=name,
        id=number,
        type=Marker.CUBE,
        action=Marker.ADD,
        pose=POSE,
        scale=Vector3(**dict(zip('xyz', box.size, strict=True))),
        color=ColorRGBA(r=red, g=green, b=blue, a=1.0),
    )
