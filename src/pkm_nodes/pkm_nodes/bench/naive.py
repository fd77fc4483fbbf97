"""Run a node of the cell in rclpy's own executor: `python -m pkm_nodes.bench.naive machine --ros-args ...`."""

import sys
from importlib import import_module

import rclpy
from rclpy.executors import SingleThreadedExecutor

from pkm_nodes.runtime.node import run


def spin(nodes):
    """Serve `nodes` in the way of `rclpy.spin`."""
    executor = SingleThreadedExecutor(context=rclpy.get_default_context())
    for node in nodes:
        executor.add_node(node)
    executor.spin()


if __name__ == '__main__':
    name = sys.argv.pop(1)
    sys.exit(run(import_module(f'pkm_nodes.nodes.{name}').make_nodes, spin=spin))
