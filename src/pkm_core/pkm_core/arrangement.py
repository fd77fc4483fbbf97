"""Where the control loop of a cell runs; chosen with `--arrangement`."""

from enum import StrEnum


class Arrangement(StrEnum):
    """The simulation without ROS, or the ROS 2 graph in one process or in one process per node."""

    simulation = 'simulation'
    composed = 'composed'
    processes = 'processes'
