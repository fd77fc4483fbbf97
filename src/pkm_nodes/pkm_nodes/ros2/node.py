"""`ros2 node list`."""

import sys
import time

from pkm_nodes.ros2.shared import add_commands, add_graph_arguments, ros_node


def add_arguments(parser):
    """Add the verbs of `ros2 node`."""
    verb = add_commands(parser, {'list': 'Output a list of available nodes'})['list']
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
