"""`ros2 topic hz`."""

import sys

import rclpy
from rclpy.clock import Clock
from rclpy.qos import qos_profile_sensor_data

from pkm_nodes.ros2.shared import (
    find_topic_class,
    message_filter,
    ros_node,
    spin_until_done,
    wait_for_publishers,
)
from pkm_nodes.ros2.timing import RECEIVED_HERE, Intervals, add_window_arguments


def add_arguments(parser):
    """Add the arguments of `ros2 topic hz`."""
    parser.set_defaults(main=hz)
    add_window_arguments(parser, 'rate')
    add = parser.add_argument
    add('--filter', metavar='EXPR', help='only measure messages matching the specified Python expression')
    add('--wall-time', action='store_true', help='calculates rate using wall time, also when there is a simulated one')


def hz(args):
    """Print the rate of a topic once per second with messages, until Ctrl-C."""
    passes = message_filter(args.filter)
    intervals = Intervals(args.window)
    with ros_node(use_sim_time=args.use_sim_time) as node:
        clock = Clock() if args.wall_time else node.get_clock()

        def on_message(msg):
            if passes(msg) and (report := intervals.count(clock.now().nanoseconds)):
                print(report)

        wait_for_publishers(node, args.topic_name, args.spin_time)
        message_class = find_topic_class(node, args.topic_name)
        print(f'intervals are {RECEIVED_HERE}', file=sys.stderr)
        # without a filter the bytes are enough, and faster topics can be measured
        node.create_subscription(
            message_class, args.topic_name, on_message, qos_profile_sensor_data, raw=args.filter is None
        )
        spin_until_done(node, rclpy.Future())
