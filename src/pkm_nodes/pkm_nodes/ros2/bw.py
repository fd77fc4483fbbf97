"""`ros2 topic bw`."""

import sys
from collections import deque

import rclpy
from rclpy.qos import qos_profile_sensor_data

from pkm_nodes.ros2.shared import (
    FIND_TIMEOUT,
    add_graph_arguments,
    find_topic_class,
    number,
    ros_node,
    spin_until_done,
    wait_for_publishers,
)
from pkm_nodes.ros2.timing import RECEIVED_HERE

# divisor and name of the unit, by the largest bandwidth it is used for [bytes/s]
_UNITS = ((1e3, '{:.0f} B', 1), (1e6, '{:.2f} KB', 1e3), (float('inf'), '{:.2f} MB', 1e6))


def add_arguments(parser):
    """Add the arguments of `ros2 topic bw`."""
    parser.set_defaults(main=bw)
    add_graph_arguments(parser, FIND_TIMEOUT)
    parser.add_argument('topic_name', metavar='topic', help='Topic name to monitor for bandwidth utilization')
    parser.add_argument(
        '--window',
        '-w',
        type=number(int, lambda n: n > 0, 'a positive integer'),
        default=100,
        help='maximum window size, in # of messages, for calculating rate (default: %(default)s)',
    )


def bw(args):
    """Print the bandwidth of a topic once per second, until Ctrl-C."""
    received = deque(maxlen=args.window)  # (time [ns], size [bytes])
    with ros_node(use_sim_time=args.use_sim_time) as node:
        wait_for_publishers(node, args.topic_name, args.spin_time)
        message_class = find_topic_class(node, args.topic_name)
        clock = node.get_clock()

        def on_message(data):
            now = clock.now().nanoseconds
            if received and now < received[-1][0]:
                print('WARNING: time is reset!', file=sys.stderr)
                received.clear()
            received.append((now, len(data)))

        def report():
            if text := bandwidth(list(received), clock.now().nanoseconds):
                print(text)

        node.create_subscription(message_class, args.topic_name, on_message, qos_profile_sensor_data, raw=True)
        node.create_timer(1.0, report)
        print(f'Subscribed to [{args.topic_name}]')
        print(f'bandwidth is {RECEIVED_HERE}', file=sys.stderr)
        spin_until_done(node, rclpy.Future())


def bandwidth(received, now):
    """Return the report about messages `received` as [(time [ns], size [bytes])] until `now` [ns]; '' for too few."""
    if len(received) < 2 or now <= received[0][0]:
        return ''
    sizes = [size for _, size in received]
    rate = sum(sizes) / ((now - received[0][0]) * 1e-9)
    text, divisor = next((text, divisor) for bound, text, divisor in _UNITS if rate < bound)
    rate, mean, least, most = (
        text.format(value / divisor) for value in (rate, sum(sizes) / len(sizes), min(sizes), max(sizes))
    )
    return f'{rate}/s from {len(sizes)} messages\n\tMessage size mean: {mean} min: {least} max: {most}'
