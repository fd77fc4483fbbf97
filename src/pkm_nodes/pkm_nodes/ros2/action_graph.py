"""`ros2 action info`, `list` and `type`."""

import time

from rclpy.action import graph

from pkm_nodes.ros2.shared import add_graph_arguments, find_types, names_and_types, print_names, ros_node

VERBS = {
    'info': 'Print information about an action',
    'list': 'Output a list of action names',
    'type': "Print a action's type",
}


def add_arguments(verbs):
    """Add the arguments of these verbs to their parsers, {name: parser}."""
    for name, main in (('info', info), ('list', list_), ('type', type_)):
        verbs[name].set_defaults(main=main)
        add_graph_arguments(verbs[name])
        if name != 'list':
            verbs[name].add_argument('action_name', help="Name of the ROS action to get info (e.g. '/fibonacci')")
        if name != 'type':
            verbs[name].add_argument(
                '-t', '--show-types', action='store_true', help='Additionally show the action type'
            )
    counted = 'Only display the number of action'
    verbs['info'].add_argument('-c', '--count', action='store_true', help=f'{counted} clients and action servers')
    verbs['list'].add_argument('-c', '--count-actions', action='store_true', help=f'{counted}s discovered')


def list_(args):
    """Print the names of the actions."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        time.sleep(args.spin_time)
        listed = names_and_types(graph.get_action_names_and_types(node), include_hidden=True)
    print_names(listed, count=args.count_actions, show_types=args.show_types)


def type_(args):
    """Print the types of an action; exit code 1 if there is no such action."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        name = node.resolve_topic_name(args.action_name)
        types = find_types(lambda: graph.get_action_names_and_types(node), name, args.spin_time)
    print(*types or (), sep='\n', end='\n' if types else '')
    return 0 if types else 1


def info(args):
    """Print the clients and servers of an action; both are empty for an unknown one, as in ros2cli."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        time.sleep(args.spin_time)
        name = node.resolve_topic_name(args.action_name)
        sides = (
            ('Action clients', _nodes_with(node, name, graph.get_action_client_names_and_types_by_node)),
            ('Action servers', _nodes_with(node, name, graph.get_action_server_names_and_types_by_node)),
        )
    print(f'Action: {args.action_name}')
    for title, nodes in sides:
        print(f'{title}: {len(nodes)}')
        for full_name, types in () if args.count else nodes:
            print(f'    {full_name} [{", ".join(types)}]' if args.show_types else f'    {full_name}')


def _nodes_with(node, action, actions_of):
    """Return [(full name, types)] of the nodes for which `actions_of(node, name, namespace)` has `action`."""
    return [
        (f'{namespace.rstrip("/")}/{name}', types)
        for name, namespace in sorted(node.get_node_names_and_namespaces())
        for found, types in actions_of(node, name, namespace)
        if found == action
    ]
