"""`ros2 topic pub`."""

import sys
import time

from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.ros2.messages import make_message, parse_yaml
from pkm_nodes.ros2.qos import add_qos_arguments, profile_of
from pkm_nodes.ros2.shared import NODE_PREFIX, add_graph_arguments, number, ros_node
from pkm_nodes.runtime.discovery import POLL

_POSITIVE = number(float, lambda value: value > 0, 'positive')
_COUNT = number(int, lambda value: value >= 0, 'positive or zero')


def add_arguments(parser):
    """Add the arguments of `ros2 topic pub`."""
    parser.set_defaults(main=pub)
    add = parser.add_argument
    add('topic_name', help="Name of the ROS topic to publish to (e.g. '/chatter')")
    add('message_type', help="Type of the ROS message (e.g. 'std_msgs/String')")
    values = parser.add_mutually_exclusive_group()
    values.add_argument(
        'values',
        nargs='?',
        default='{}',
        help="Values to fill the message with in YAML format (e.g. 'data: Hello World'), "
        'otherwise the message will be published with default values',
    )
    values.add_argument('--stdin', action='store_true', help='Read values from standard input')
    add('-r', '--rate', metavar='N', type=_POSITIVE, default=1.0, help='Publishing rate in Hz (default: 1)')
    add('-p', '--print', metavar='N', type=int, default=1, help='Only print every N-th published message (default: 1)')
    number_of = parser.add_mutually_exclusive_group()
    number_of.add_argument('-1', '--once', action='store_true', help='Publish one message and exit')
    number_of.add_argument('-t', '--times', type=_COUNT, default=0, help='Publish this number of times and then exit')
    add(
        '-w',
        '--wait-matching-subscriptions',
        type=_COUNT,
        help='Wait until finding the specified number of matching subscriptions. '
        'Defaults to 1 when using "-1"/"--once"/"--times", otherwise defaults to 0.',
    )
    add('--max-wait-time-secs', type=_POSITIVE, help='Maximum time in seconds to wait for subscriptions')
    add(
        '--keep-alive',
        metavar='N',
        type=_POSITIVE,
        default=0.1,
        help='Keep publishing node alive for N seconds after the last msg (default: 0.1)',
    )
    add('-n', '--node-name', help='Name of the created publishing node')
    add_qos_arguments(parser, 'publish', 'default', fits='')
    add_graph_arguments(parser)


def pub(args):
    """Publish a message once, a number of times, or at a rate until Ctrl-C."""
    times = 1 if args.once else args.times
    wanted = args.wait_matching_subscriptions
    wanted = int(times != 0) if wanted is None else wanted
    if not wanted and args.max_wait_time_secs is not None:
        return '--max-wait-time-secs option is only effective with --wait-matching-subscriptions, --once or --times'
    message_class = find_interface(args.message_type, 'msg')
    values = parse_yaml(sys.stdin.read() if args.stdin else args.values)
    if not isinstance(values, dict):
        return 'The passed value needs to be a dictionary in YAML format'
    stamps = []
    try:
        message = make_message(message_class, values, stamps)
    except Exception as error:  # the message of any converter; the user corrects the value
        return f'Failed to populate field: {error}'
    name = args.node_name or f'{NODE_PREFIX}_publisher_{args.message_type.replace("/", "_")}'
    with ros_node(name, args.use_sim_time) as node:
        publisher = node.create_publisher(message_class, args.topic_name, profile_of(args)[0])
        refusal = _wait_for_subscriptions(publisher, wanted, args.max_wait_time_secs)
        if refusal:
            return refusal
        print('publisher: beginning loop')
        _publish(node, publisher, message, stamps, times, args)
        time.sleep(args.keep_alive)
    return None


def _wait_for_subscriptions(publisher, wanted, timeout):
    """Wait for the `wanted` number of subscriptions; return a refusal after `timeout` [s], '' if they are there."""
    begun = said = time.monotonic()
    while (found := publisher.get_subscription_count()) < wanted:
        now = time.monotonic()
        if now >= said:
            print(f'Waiting for at least {wanted} matching subscription(s)...')
            said = now + 1.0
        if timeout is not None and now - begun >= timeout:
            return f'Timed out waiting for subscribers: Expected {wanted} subscribers but only got {found} subscribers'
        time.sleep(POLL)
    return ''


def _publish(node, publisher, message, stamps, times, args):
    """Publish `message` with the current time in its `stamps`, `times` times at the rate, 0 until Ctrl-C."""
    count, due = 0, time.monotonic()
    while not times or count < times:
        now = node.get_clock().now().to_msg()
        for stamp in stamps:
            stamp.sec, stamp.nanosec = now.sec, now.nanosec
        count += 1
        if args.print and count % args.print == 0:
            print(f'publishing #{count}: {message!r}\n')
        publisher.publish(message)
        due += 1 / args.rate
        time.sleep(max(0.0, due - time.monotonic()) if count != times else 0.0)
