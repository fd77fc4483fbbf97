"""`ros2 topic list`; `delay`, `echo` and `hz` have their own files."""

import argparse
import time

from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from pkm_nodes.ros2 import delay, echo, hz
from pkm_nodes.ros2.shared import add_commands, add_graph_arguments, ros_node


def add_arguments(parser):
    """Add the verbs of `ros2 topic`."""
    hidden = dict(action='store_true', help='Consider hidden topics as well')
    parser.add_argument('--include-hidden-topics', **hidden)
    verbs = add_commands(
        parser,
        {
            'delay': 'Display delay of topic from timestamp in header',
            'echo': 'Output messages from a topic',
            'hz': 'Print the average publishing rate to screen',
            'list': 'Output a list of available topics',
        },
    )
    delay.add_arguments(verbs['delay'])
    echo.add_arguments(verbs['echo'])
    hz.add_arguments(verbs['hz'])

    verbs['list'].set_defaults(main=list_topics)
    add_graph_arguments(verbs['list'])
    add = verbs['list'].add_argument
    add('-t', '--show-types', action='store_true', help='Additionally show the topic type')
    add('-c', '--count-topics', action='store_true', help='Only display the number of topics discovered')
    add('--include-hidden-topics', **hidden, default=argparse.SUPPRESS)  # as given before `list`, unless given here
    add('-v', '--verbose', action='store_true', help='List full details about each topic')


def list_topics(args):
    """Print the names of the topics; with --verbose the published ones, then the subscribed ones."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        time.sleep(args.spin_time)
        topics = [
            (name, ', '.join(types), node.count_publishers(name), node.count_subscribers(name))
            for name, types in node.get_topic_names_and_types()
            if args.include_hidden_topics or not topic_or_service_is_hidden(name)
        ]
    if args.count_topics:
        print(len(topics))
    elif args.verbose:
        _print_side('Published', 'publisher', [(name, types, count) for name, types, count, _ in topics])
        _print_side('Subscribed', 'subscriber', [(name, types, count) for name, types, _, count in topics])
    else:
        for name, types, *_ in topics:
            print(f'{name} [{types}]' if args.show_types else name)


def _print_side(title, endpoint, topics):
    print(f'{title} topics:')
    for name, types, count in topics:
        if count:
            print(f' * {name} [{types}] {count} {endpoint}{"s" if count > 1 else ""}')
    print()
