"""The links of a machine as visualization_msgs/MarkerArray, for tools that take no URDF."""

from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from pkm_core.description import ROOT, base_boxes, frames, links, moved


class LinkMarkers:
    """Turns joint positions into one CUBE marker a box of `pkm_core.description`."""

    def __init__(self, machine):
        self._links = links(machine)
        self._boxes = {ROOT: base_boxes(machine)} | {link.name: link.boxes for link in self._links}

    def message(self, stamp, positions):
        """Return the markers at `positions` (of `joint_positions`), all in the base frame."""
        found = frames(self._links, positions)
        header = Header(stamp=stamp, frame_id=ROOT)
        markers = []
        for name, boxes in self._boxes.items():
            turn, origin = found[name]
            for number, box in enumerate(boxes):
                x, y, z = moved(turn, origin, box.centre)
                red, green, blue = box.colour
                markers.append(
                    Marker(
                        header=header,
                        ns=name,
                        id=number,
                        type=Marker.CUBE,
                        action=Marker.ADD,
                        pose=Pose(
                            position=Point(x=x, y=y, z=z),
                            orientation=Quaternion(**dict(zip('wxyz', turn, strict=True))),
                        ),
                        scale=Vector3(**dict(zip('xyz', box.size, strict=True))),
                        color=ColorRGBA(r=red, g=green, b=blue, a=1.0),
                    )
                )
        return MarkerArray(markers=markers)
