"""`ros2 topic echo`."""

import sys
from time import monotonic_ns

import rclpy
import yaml
from rclpy.event_handler import SubscriptionEventCallbacks

from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.ros2.messages import message_to_csv, message_to_yaml
from pkm_nodes.ros2.qos import add_qos_arguments, choose_qos
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
from pkm_nodes.ros2.timing import RECEIVED_HERE, Intervals

# [messages] whose intervals are printed at the end
_WINDOW = 10_000


def add_arguments(parser):
    """Add the arguments of `ros2 topic echo`."""
    parser.set_defaults(main=echo)
    add_graph_arguments(parser, FIND_TIMEOUT)
    add_qos_arguments(parser)
    add = parser.add_argument
    add('topic_name', help=TOPIC_HELP)
    add('message_type', nargs='?', help="Type of the ROS message (e.g. 'std_msgs/msg/String')")
    add('--csv', action='store_true', help='Output all recursive fields separated by commas (e.g. for plotting)')
    add('--field', help="Echo a selected field of a message. Use '.' to select sub-fields (e.g. pose.pose.position)")
    add('--full-length', '-f', action='store_true', help='Output all elements for arrays, bytes, and string')
    add(
        '--truncate-length',
        '-l',
        type=number(int, lambda n: n >= 0, 'non-negative integer'),
        default=128,
        help='The length to truncate arrays, bytes, and string to (default: %(default)s)',
    )
    add('--no-arr', action='store_true', help="Don't print array fields of messages")
    add('--no-str', action='store_true', help="Don't print string fields of messages")
    add('--flow-style', action='store_true', help='Print collections in the flow style (not available with csv format)')
    add('--no-lost-messages', action='store_true', help="Don't report when a message is lost")
    add('--raw', action='store_true', help='Echo the raw binary representation')
    add(
        '--filter',
        metavar='FILTER_EXPR',
        help='Python expression to filter messages that are printed; m is the message',
    )
    add('--once', action='store_true', help='Print the first message received and then exit.')
    add(
        '--timeout',
        metavar='N',
        type=number(float, lambda seconds: seconds > 0, 'positive'),
        help='Set a timeout in seconds for waiting',
    )
    add('--include-message-info', '-i', action='store_true', help='Shows the associated message info.')


def echo(args):
    """Print the messages of a topic until Ctrl-C, --timeout or, with --once, the first one."""
    fields = [name for name in (args.field or '').split('.') if name]
    if args.field is not None and not fields:
        return f"Invalid field value '{args.field}'"
    passes = message_filter(args.filter)
    done = rclpy.Future()
    intervals = Intervals(_WINDOW)

    def on_message(msg, info):
        intervals.count(monotonic_ns())
        value = _select(msg, fields)
        if not done.done() and passes(value):
            _print(value, info, args)
            if args.once:
                done.set_result(True)

    with ros_node(use_sim_time=args.use_sim_time) as node:
        wait_for_publishers(node, args.topic_name, args.spin_time)
        if args.message_type is None:
            message_class = find_topic_class(node, args.topic_name)
        else:
            message_class = find_interface(args.message_type, 'msg')
        node.create_subscription(
            message_class,
            args.topic_name,
            on_message,
            choose_qos(node, args.topic_name, args),
            event_callbacks=SubscriptionEventCallbacks(message_lost=None if args.no_lost_messages else _report_lost),
            raw=args.raw,
        )
        if args.timeout:
            node.create_timer(args.timeout, lambda: done.set_result(True))
        try:
            spin_until_done(node, done)
        finally:
            if intervals.window.times:
                times = intervals.window.percentiles()
                print(f'intervals of the messages: {times} ({RECEIVED_HERE})', file=sys.stderr)
    return None


def _select(msg, fields):
    """Return the nested field `fields` of the message."""
    for name in fields:
        try:
            msg = getattr(msg, name)
        except AttributeError as error:
            raise RuntimeError(f"Invalid field '{'.'.join(fields)}': {error}") from error
    return msg


def _print(value, info, args):
    """Print a message or one of its fields in the format of the arguments."""
    options = dict(
        truncate_length=None if args.full_length else args.truncate_length, no_arr=args.no_arr, no_str=args.no_str
    )
    if not hasattr(value, 'SLOT_TYPES'):  # a plain field, or the bytes of --raw
        if args.include_message_info:
            print(f'---Got new message, message info:---\n{info}\n---Message data:---')
        print(value, end='\n---\n')
    elif args.csv:
        row = [*info.values()] if args.include_message_info else []
        print(*row, message_to_csv(value, **options), sep=',')
    else:
        if args.include_message_info:
            print(yaml.dump(info), end='---\n')
        print(message_to_yaml(value, flow_style=args.flow_style, **options), end='---\n')


def _report_lost(lost):
    print(
        f'A message was lost!!!\n\ttotal count change:{lost.total_count_change}\n\ttotal count: {lost.total_count}',
        end='---\n',
    )
