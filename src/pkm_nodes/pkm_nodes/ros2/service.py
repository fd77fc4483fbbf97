"""`ros2 service call`, `list`, `type` and `info`."""

import argparse
import sys
import time

from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.ros2.messages import make_message, parse_yaml
from pkm_nodes.ros2.shared import (
    FIND_TIMEOUT,
    NODE_PREFIX,
    add_commands,
    add_graph_arguments,
    find_types,
    names_and_types,
    print_names,
    ros_node,
    spin_until_done,
)


def add_arguments(parser):
    """Add the verbs of `ros2 service`."""
    hidden = dict(action='store_true', help='Consider hidden services as well')
    parser.add_argument('--include-hidden-services', **hidden)
    verbs = add_commands(
        parser,
        {
            'call': 'Call a service',
            'info': 'Print information about a service',
            'list': 'Output a list of available services',
            'type': "Output a service's type",
        },
    )
    _add_call(verbs['call'])
    for name, main in (('info', info), ('list', list_), ('type', type_)):
        verbs[name].set_defaults(main=main)
        add_graph_arguments(verbs[name])
        if name != 'list':
            about = f"Name of the ROS service to get {name} (e.g. '/talker/list_parameters')"
            verbs[name].add_argument('service_name', help=about)
    add = verbs['list'].add_argument
    add('-t', '--show-types', action='store_true', help='Additionally show the service type')
    add('-c', '--count-services', action='store_true', help='Only display the number of services discovered')
    add('--include-hidden-services', **hidden, default=argparse.SUPPRESS)  # as given before `list`, unless given here


def _add_call(verb):
    verb.set_defaults(main=call)
    verb.add_argument('service_name', help="Name of the ROS service to call to (e.g. '/add_two_ints')")
    verb.add_argument('service_type', help="Type of the ROS service (e.g. 'std_srvs/srv/Empty')")
    values = verb.add_mutually_exclusive_group()
    values.add_argument(
        'values',
        nargs='?',
        default='{}',
        help="Values to fill the service request with in YAML format (e.g. '{a: 1, b: 2}'), "
        'otherwise the service request will be published with default values',
    )
    values.add_argument('--stdin', action='store_true', help='Read values from standard input')
    verb.add_argument('-r', '--rate', metavar='N', type=float, help='Repeat the call at a specific rate in Hz')


def call(args):
    """Call the service once, or at a rate until Ctrl-C, and print each response."""
    if args.rate is not None and args.rate <= 0:
        return 'rate must be greater than zero'
    service = find_interface(args.service_type, 'srv')
    values = parse_yaml(sys.stdin.read() if args.stdin else args.values)
    try:
        request = make_message(service.Request, values)
    except Exception as error:  # the message of any converter; the user corrects the value
        return f'Failed to populate field: {error}'
    package, *_, name = args.service_type.split('/')
    with ros_node(f'{NODE_PREFIX}_requester_{package}_{name}') as node:
        client = node.create_client(service, args.service_name)
        if not client.service_is_ready():
            print('waiting for service to become available...')
            if not client.wait_for_service(FIND_TIMEOUT):
                return f"No service '{args.service_name}' of type '{args.service_type}' within {FIND_TIMEOUT} s"

        def check():
            if not client.service_is_ready():
                raise RuntimeError(f"The service '{args.service_name}' has left the graph without an answer")

        while True:
            called = time.monotonic()
            print(f'requester: making request: {request!r}\n')
            print(f'response:\n{spin_until_done(node, client.call_async(request), check=check)!r}\n')
            if args.rate is None:
                return None
            time.sleep(max(0.0, called + 1 / args.rate - time.monotonic()))


def list_(args):
    """Print the names of the services."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        time.sleep(args.spin_time)
        listed = names_and_types(node.get_service_names_and_types(), args.include_hidden_services)
    print_names(listed, count=args.count_services, show_types=args.show_types)


def type_(args):
    """Print the types of a service; exit code 1 if there is no such service."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        name = node.resolve_service_name(args.service_name)
        types = find_types(node.get_service_names_and_types, name, args.spin_time)
    print(*types or (), sep='\n', end='\n' if types else '')
    return 0 if types else 1


def info(args):
    """Print type and numbers of clients and servers of a service."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        time.sleep(args.spin_time)
        name = node.resolve_service_name(args.service_name)
        types = dict(node.get_service_names_and_types()).get(name)
        if not types:
            return f"Unknown service '{args.service_name}'"
        print(f'Type: {types[0] if len(types) == 1 else types}')
        print(f'Clients count: {node.count_clients(name)}')
        print(f'Services count: {node.count_services(name)}')
    return None
