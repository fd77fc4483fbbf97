"""Run a node of the cell in rclpy's own executor: `python -m pkm_nodes.bench.naive machine --ros-args ...`."""

import sys
from importlib import import_module

import rclpy
from rclpy.executors import SingleThreadedExecutor


def spin(nodes):
    """Serve `nodes` in the way of `rclpy.spin`."""
    executor = SingleThreadedExecutor(context=rclpy.get_default_context())
    for node in nodes:
        executor.add_node(node)
    executor.spin()


if __name__ == '__main__':
    name = sys.argv.pop(1)
    import_module(f'pkm_nodes.nodes.{name}').main(spin=spin)
