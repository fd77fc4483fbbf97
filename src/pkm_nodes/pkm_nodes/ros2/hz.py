"""`ros2 topic hz`."""

import sys
from collections import deque

import numpy as np
import rclpy
from rclpy.clock import Clock
from rclpy.qos import qos_profile_sensor_data

from pkm_nodes.ros2.shared import (
    FIND_TIMEOUT,
    TOPIC_HELP,
    add_graph_arguments,
    find_topic_class,
    message_filter,
    number,
    ros_node,
    spin_until_done,
    wait_for_publishers,
)


def add_arguments(parser):
    """Add the arguments of `ros2 topic hz`."""
    parser.set_defaults(main=hz)
    add_graph_arguments(parser, FIND_TIMEOUT)
    add = parser.add_argument
    add('topic_name', help=TOPIC_HELP)
    add(
        '--window',
        '-w',
        type=number(int, lambda n: n > 0, 'a positive integer'),
        default=10000,
        help='window size, in # of messages, for calculating rate (default: %(default)s)',
    )
    add('--filter', metavar='EXPR', help='only measure messages matching the specified Python expression')
    add('--wall-time', action='store_true', help='calculates rate using wall time, also when there is a simulated one')


def hz(args):
    """Print the rate of a topic every second in which messages come, until Ctrl-C."""
    passes = message_filter(args.filter)
    rate = ReceiveRate(args.window)
    with ros_node(use_sim_time=args.use_sim_time) as node:
        clock = Clock() if args.wall_time else node.get_clock()

        def on_message(msg):
            if passes(msg) and (report := rate.count(clock.now().nanoseconds)):
                print(report)

        wait_for_publishers(node, args.topic_name, args.spin_time)
        message_class = find_topic_class(node, args.topic_name)
        print('The rate is that of receiving here; messages lost on the way are not in it.', file=sys.stderr)
        # without a filter the bytes are enough, which keeps up with faster topics
        node.create_subscription(
            message_class, args.topic_name, on_message, qos_profile_sensor_data, raw=args.filter is None
        )
        spin_until_done(node, rclpy.Future())


class ReceiveRate:
    """Statistics of the times between messages over a window of so many messages."""

    def __init__(self, window):
        self._intervals = deque(maxlen=window)  # [ns]
        self._last = None  # [ns] time of the last message
        self._reported = None  # [ns]

    def count(self, now):
        """Count a message at the time now [ns]; return a report, at most one a second."""
        if self._last is None or now < self._last:  # the first, or simulated time was reset
            self._intervals.clear()
            self._last, self._reported = now, None
            return None
        self._intervals.append(now - self._last)
        self._last = now
        if self._reported is None:
            self._reported = now
        if now - self._reported < 1e9:
            return None
        self._reported = now
        seconds = np.array(self._intervals) * 1e-9
        mean = seconds.mean()
        return (
            f'average rate: {1 / mean if mean else 0:.3f}\n'
            f'\tmin: {seconds.min():.3f}s max: {seconds.max():.3f}s '
            f'std dev: {seconds.std():.5f}s window: {len(seconds)}'
        )
