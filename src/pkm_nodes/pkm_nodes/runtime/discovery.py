"""Discovery of the ROS graph: its range, and waiting for it. Needs no rclpy."""

import os
import time

from pkm_nodes.runtime.environment import check_ros_environment

# [s] until a new node knows the graph: Fast DDS announces a process every 3 s
DISCOVERY_TIME = 3.5
# [s] between two looks at the graph; signals are answered within this time
POLL = 0.1


def discover_on_this_computer():
    """
    Limit discovery to this computer, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set; check the environment of ROS.

    Call it before rclpy is initialised; processes started later inherit it. Cells of two computers on one network would
    otherwise meet.
    """
    check_ros_environment()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def wait_for(found, timeout):
    """Poll `found()` until it returns something true, at most `timeout` [s]; return its last answer."""
    deadline = time.monotonic() + timeout
    while not (answer := found()) and time.monotonic() < deadline:
        time.sleep(POLL)
    return answer


def knows_whole_graph():
    """Return whether a node knows all publishers. Behind a discovery server it knows those of its own topics only."""
    return not os.environ.get('ROS_DISCOVERY_SERVER')
