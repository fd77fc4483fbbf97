"""`ros2 topic delay`."""

import sys

import rclpy
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time

from pkm_nodes.ros2.shared import (
    find_topic_class,
    ros_node,
    spin_until_done,
    wait_for_publishers,
)
from pkm_nodes.ros2.timing import RECEIVED_HERE, Window, add_window_arguments


def add_arguments(parser):
    """Add the arguments of `ros2 topic delay`."""
    parser.set_defaults(main=delay)
    add_window_arguments(parser, 'delay')


def delay(args):
    """Print the age of a topic's messages, by their header stamp, once per second with messages, until Ctrl-C."""
    window = Window(args.window)
    with ros_node(use_sim_time=args.use_sim_time) as node:

        def on_message(msg):
            now = node.get_clock().now().nanoseconds
            window.times.append(now - Time.from_msg(msg.header.stamp).nanoseconds)
            if window.is_due(now):
                print(f'average delay: {window.mean():.3f}\n{window.summary()}')

        wait_for_publishers(node, args.topic_name, args.spin_time)
        message_class = find_topic_class(node, args.topic_name)
        if not hasattr(message_class(), 'header'):
            raise RuntimeError(f'{args.topic_name}: msg does not have header')
        clock = 'simulated time of /clock' if args.use_sim_time else 'system time; -s takes the simulated one'
        print(f'delays from the stamp to now ({clock}) are {RECEIVED_HERE}', file=sys.stderr)
        node.create_subscription(message_class, args.topic_name, on_message, qos_profile_sensor_data)
        spin_until_done(node, rclpy.Future())
