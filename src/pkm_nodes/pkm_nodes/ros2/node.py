"""`ros2 node list` and `info`."""

import sys
import time

from rclpy.action import graph

from pkm_nodes.ros2.shared import add_commands, add_graph_arguments, names_and_types, ros_node


def add_arguments(parser):
    """Add the verbs of `ros2 node`."""
    verbs = add_commands(
        parser, {'info': 'Output information about a node', 'list': 'Output a list of available nodes'}
    )
    verbs['info'].set_defaults(main=info)
    add_graph_arguments(verbs['info'])
    verbs['info'].add_argument('node_name', help='Node name to request information')
    hidden = 'Display hidden topics, services, and actions as well'
    verbs['info'].add_argument('--include-hidden', action='store_true', help=hidden)
    verb = verbs['list']
    verb.set_defaults(main=list_nodes)
    add_graph_arguments(verb)
    verb.add_argument('-a', '--all', action='store_true', help='Display all nodes even hidden ones')
    verb.add_argument('-c', '--count-nodes', action='store_true', help='Only display the number of nodes discovered')


def node_names(node, include_hidden=False):
    """Return [(name, namespace, full name)] of the nodes in the graph, sorted."""
    return sorted(
        (name, namespace, f'{namespace.rstrip("/")}/{name}')
        for name, namespace in node.get_node_names_and_namespaces()
        if include_hidden or (name and not name.startswith('_'))
    )


def list_nodes(args):
    """Print the full names of the nodes."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        time.sleep(args.spin_time)
        names = sorted(full_name for _, _, full_name in node_names(node, args.all))
    if args.count_nodes:
        print(len(names))
        return
    if len(set(names)) < len(names):
        print(
            'WARNING: Be aware that there are nodes in the graph that share an exact name, '
            'which can have unintended side effects.',
            file=sys.stderr,
        )
    for name in names:
        print(name)


def info(args):
    """Print the endpoints of a node."""
    wanted = f'/{args.node_name.removeprefix("/")}'
    with ros_node(use_sim_time=args.use_sim_time) as node:
        time.sleep(args.spin_time)
        found = [each for each in node_names(node, args.include_hidden) if each[2] == wanted]
        if not found:
            return f"Unable to find node '{args.node_name}'"
        if len(found) > 1:
            print(
                f'There are {len(found)} nodes in the graph with the exact name "{wanted}". '
                'You are seeing information about only one of them.',
                file=sys.stderr,
            )
        name, namespace, _ = found[0]
        print(wanted)
        for title, names in (
            ('Subscribers', node.get_subscriber_names_and_types_by_node(name, namespace)),
            ('Publishers', node.get_publisher_names_and_types_by_node(name, namespace)),
            ('Service Servers', node.get_service_names_and_types_by_node(name, namespace)),
            ('Service Clients', node.get_client_names_and_types_by_node(name, namespace)),
            ('Action Servers', graph.get_action_server_names_and_types_by_node(node, name, namespace)),
            ('Action Clients', graph.get_action_client_names_and_types_by_node(node, name, namespace)),
        ):
            print(f'  {title}:')
            listed = names_and_types(names, args.include_hidden)
            print(*(f'    {name}: {types}' for name, types in listed), sep='\n')
    return None
