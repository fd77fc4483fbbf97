"""`ros2 bag record`: any topics of the graph into a rosbag2 folder of MCAP files, by bag_recorder.py."""

import argparse
import re
import time
from datetime import datetime
from pathlib import Path

from pkm_core.interrupts import Interrupted, held_back
from pkm_nodes.ros2.shared import number, ros_node


def add_arguments(verb):
    """Add the arguments of `ros2 bag record`."""
    verb.set_defaults(main=record)
    add = verb.add_argument
    add('topics', nargs='*', help='List of topics to record.')
    add('--topics', dest='more_topics', nargs='+', default=[], metavar='TOPIC', help='List of topics to record.')
    add('-a', '--all', action='store_true', help='Record all topics, and those that appear later.')
    add('-e', '--regex', type=_pattern, help='Record topics that match the regular expression.')
    add('--exclude-regex', type=_pattern, help='Exclude topics that match the regular expression.')
    add('-o', '--output', type=Path, help='Destination of the bag, default: rosbag2_YEAR_MONTH_DAY-HOUR_MINUTE_SECOND')
    add('-s', '--storage', choices=['mcap'], default='mcap', help='Storage; default: mcap, the only one here.')
    add('--include-hidden-topics', action='store_true', help='Record hidden topics as well')
    add('--no-discovery', action='store_true', help='Do not look for topics after the start.')
    add(
        '-p',
        '--polling-interval',
        type=number(int, lambda value: value > 0, 'a positive integer'),
        default=100,
        help='Time in ms between two looks for topics. Default: %(default)s',
    )
    add(
        '-d',
        '--max-bag-duration',
        type=number(int, lambda value: value >= 0, 'positive or zero'),
        default=0,
        help='Time in s after which the bag continues in a new file. Default: %(default)s, one file.',
    )
    add(
        '--custom-data',
        nargs='+',
        default=[],
        type=_fact,
        metavar='KEY=VALUE',
        help='Store these facts in the metadata of the bag.',
    )
    add('--use-sim-time', action='store_true', help='Stamp messages with the simulated time of /clock')


def _pattern(text):
    try:
        return re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f"'{text}' is not a regular expression: {error}") from error


def _fact(text):
    key, separator, value = text.partition('=')
    if not (key and separator):
        raise argparse.ArgumentTypeError(f"'{text}' given; expected KEY=VALUE")
    return key, value


def record(args):
    """Record until Ctrl-C or SIGTERM, which close the bag; print how many messages it has and how many were lost."""
    from pkm_core.bag.writer import BagWriter
    from pkm_nodes.ros2.bag_recorder import Recorder

    args.topics = [*args.topics, *args.more_topics]
    if not (args.all or args.topics or args.regex):
        return 'Need to specify one option out of --all, --topics, --regex'
    path = args.output or Path(f'rosbag2_{datetime.now():%Y_%m_%d-%H_%M_%S}')
    if path.exists():
        return f"Output folder '{path}' already exists."
    with ros_node(f'rosbag2_recorder_{time.monotonic_ns()}', args.use_sim_time) as node:
        args.topics = [node.resolve_topic_name(topic) for topic in args.topics]
        writer = BagWriter(path, {}, dict(args.custom_data))
        recorder = Recorder(node, writer, args)
        try:
            recorder.run()
        except Interrupted:
            with held_back():
                recorder.close()
        except BaseException:
            writer.abandon()
            raise
    return None
