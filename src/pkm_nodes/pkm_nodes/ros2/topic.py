"""`ros2 topic list`, `type` and `info`; the other verbs have their own files."""

import argparse
import time

from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from pkm_nodes.ros2 import bw, delay, echo, hz, pub
from pkm_nodes.ros2.shared import add_commands, add_graph_arguments, find_types, ros_node


def add_arguments(parser):
    """Add the verbs of `ros2 topic`."""
    hidden = dict(action='store_true', help='Consider hidden topics as well')
    parser.add_argument('--include-hidden-topics', **hidden)
    verbs = add_commands(
        parser,
        {
            'bw': 'Display bandwidth used by topic',
            'delay': 'Display delay of topic from timestamp in header',
            'echo': 'Output messages from a topic',
            'hz': 'Print the average publishing rate to screen',
            'info': 'Print information about a topic',
            'list': 'Output a list of available topics',
            'pub': 'Publish a message to a topic',
            'type': "Print a topic's type",
        },
    )
    delay.add_arguments(verbs['delay'])
    echo.add_arguments(verbs['echo'])
    hz.add_arguments(verbs['hz'])
    bw.add_arguments(verbs['bw'])
    pub.add_arguments(verbs['pub'])

    for name, main in (('info', info), ('type', type_)):
        verbs[name].set_defaults(main=main)
        add_graph_arguments(verbs[name])
        verbs[name].add_argument('topic_name', help=f"Name of the ROS topic to get {name} (e.g. '/chatter')")
    details = 'the node name, node namespace, topic type, topic type hash, GUID, and QoS Profile'
    verbs['info'].add_argument(
        '-v',
        '--verbose',
        action='store_true',
        help=f'Prints detailed information like {details} of the publishers and subscribers to this topic',
    )

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


def info(args):
    """Print type and numbers of endpoints of a topic; with --verbose each endpoint."""
    end = '\n\n' if args.verbose else '\n'
    with ros_node(use_sim_time=args.use_sim_time) as node:
        time.sleep(args.spin_time)
        name = node.resolve_topic_name(args.topic_name)
        types = dict(node.get_topic_names_and_types()).get(name)
        if not types:
            return f"Unknown topic '{args.topic_name}'"
        sides = (
            ('Publisher', node.get_publishers_info_by_topic(name)),
            ('Subscription', node.get_subscriptions_info_by_topic(name)),
        )
    print(f'Type: {types[0] if len(types) == 1 else types}', end=end)
    for title, endpoints in sides:
        print(f'{title} count: {len(endpoints)}', end=end)
        for endpoint in endpoints if args.verbose else ():
            print(endpoint, end=end)
    return None


def type_(args):
    """Print the types of a topic; exit code 1 if there is no such topic."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        types = find_types(node.get_topic_names_and_types, node.resolve_topic_name(args.topic_name), args.spin_time)
    print(*types or (), sep='\n', end='\n' if types else '')
    return 0 if types else 1


def _print_side(title, endpoint, topics):
    print(f'{title} topics:')
    for name, types, count in topics:
        if count:
            print(f' * {name} [{types}] {count} {endpoint}{"s" if count > 1 else ""}')
    print()
