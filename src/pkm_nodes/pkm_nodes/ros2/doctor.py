"""`ros2 doctor`: checks of the computer and of the running graph, in the form of ros2doctor."""

import os
import platform
import socket
import sys
import time
from collections import Counter

from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.utilities import get_rmw_implementation_identifier

from pkm_nodes.ros2.node import node_names
from pkm_nodes.ros2.shared import add_graph_arguments, ros_node

_OWN_TOPICS = ('/parameter_events', '/rosout')  # every node publishes them, and nothing need subscribe to them


def add_arguments(parser):
    """Add the arguments of `ros2 doctor`."""
    parser.set_defaults(main=doctor)
    reports = parser.add_mutually_exclusive_group()
    reports.add_argument('--report', '-r', action='store_true', help='Print all reports.')
    reports.add_argument('--report-failed', '-rf', action='store_true', help='Print reports of failed checks only.')
    parser.add_argument(
        '--include-warnings',
        '-iw',
        action='store_true',
        help='Include warnings as failed checks. Warnings are ignored by default.',
    )
    parser.add_argument('--exclude-packages', '-ep', action='store_true', help='For compatibility; none are checked')
    add_graph_arguments(parser)


def doctor(args):
    """Run all checks and print the reports asked for; the exit code is 1 if a check has failed."""
    with ros_node() as node:
        time.sleep(args.spin_time)
        checks = {'network': _network(), 'node': _nodes(node), 'topic': _topics(node), 'middleware': _qos(node)}
        reports = _reports(node)
    if args.report:
        for title, _, items in reports:
            _print_report(title, items)
        return None
    for warnings, errors in checks.values():
        for text in warnings:
            print(f'WARNING: {text}', file=sys.stderr)
        for text in errors:
            print(f'ERROR: {text}', file=sys.stderr)
    failed = [name for name, (warnings, errors) in checks.items() if errors or (args.include_warnings and warnings)]
    if not failed:
        print(f'\nAll {len(checks)} checks passed\n')
        return None
    print(f'\n{len(failed)}/{len(checks)} check(s) failed\n')
    print('Failed modules:', *failed)
    for title, category, items in reports if args.report_failed else ():
        if category in failed:
            _print_report(title, items)
    return 1


def _network():
    """Return warnings and errors about the network: DDS finds other processes by multicast or on the loopback."""
    names = [name for _, name in socket.if_nameindex()]
    errors = [] if 'lo' in names else ['no loopback interface: processes of this computer do not find each other']
    return [], errors


def _nodes(node):
    """Return warnings and errors about nodes: two of the same name answer the same services."""
    counts = Counter(full_name for _, _, full_name in node_names(node))
    return [], [f'{count} nodes are called {name}' for name, count in sorted(counts.items()) if count > 1]


def _topics(node):
    """Return warnings and errors about topics with one side only."""
    warnings = []
    for name, _ in node.get_topic_names_and_types():
        publishers, subscribers = node.count_publishers(name), node.count_subscribers(name)
        if name not in _OWN_TOPICS and publishers and not subscribers:
            warnings.append(f'Publisher without subscriber detected on {name}.')
        elif name not in _OWN_TOPICS and subscribers and not publishers:
            warnings.append(f'Subscriber without publisher detected on {name}.')
    return warnings, []


def _pairs(node):
    """Yield (topic, publisher, subscription, compatibility, reason) of all pairs in the graph."""
    for name, _ in node.get_topic_names_and_types():
        for publisher in node.get_publishers_info_by_topic(name):
            for subscription in node.get_subscriptions_info_by_topic(name):
                yield (
                    name,
                    publisher,
                    subscription,
                    *qos_check_compatible(publisher.qos_profile, subscription.qos_profile),
                )


def _qos(node):
    """Return warnings and errors about quality of service: an incompatible pair exchanges no messages."""
    found = {QoSCompatibility.WARNING: [], QoSCompatibility.ERROR: []}
    words = {QoSCompatibility.WARNING: 'warning', QoSCompatibility.ERROR: 'error'}
    for name, _, _, verdict, reason in _pairs(node):
        if verdict in found:
            found[verdict].append(f"QoS compatibility {words[verdict]} found on topic '{name}': {reason}")
    return tuple(found.values())


def _reports(node):
    """Return [(title, category, [(item, value)])]."""
    environment = [(name, os.environ[name]) for name in sorted(os.environ) if name.startswith(('ROS_', 'RMW_'))]
    topics = [
        item
        for name, _ in node.get_topic_names_and_types()
        if name not in _OWN_TOPICS
        for item in (
            ('topic', name),
            ('publisher count', node.count_publishers(name)),
            ('subscriber count', node.count_subscribers(name)),
        )
    ]
    pairs = [
        item
        for name, publisher, subscription, verdict, reason in _pairs(node)
        if verdict != QoSCompatibility.OK
        for item in (
            ('topic [type]', f'{name} [{publisher.topic_type}]'),
            ('publisher node', publisher.node_name),
            ('subscriber node', subscription.node_name),
            ('compatibility status', reason),
        )
    ]
    return [
        ('NETWORK CONFIGURATION', 'network', [(name, number) for number, name in socket.if_nameindex()]),
        ('PLATFORM INFORMATION', 'platform', [
            ('system', platform.system()),
            ('platform info', platform.platform()),
            ('release', platform.release()),
            ('processor', platform.machine()),
        ]),
        ('PYTHON', 'platform', [('version', platform.python_version()), ('prefix', sys.prefix)]),
        ('ROS ENVIRONMENT', 'platform', environment or [('variables', 'none')]),
        ('RMW MIDDLEWARE', 'middleware', [('middleware name', get_rmw_implementation_identifier())]),
        ('QOS COMPATIBILITY LIST', 'middleware', pairs or [('compatibility status', 'every pair fits')]),
        ('NODE LIST', 'node', [('node', full_name) for *_, full_name in node_names(node)] or [('node', 'none')]),
        ('TOPIC LIST', 'topic', topics or [('topic', 'none')]),
    ]  # fmt: skip


def _print_report(title, items):
    width = max(8, *(len(name) + 4 for name, _ in items))
    print(f'\n   {title}')
    for name, value in items:
        print(f'{name:{width}}: {value}')
