"""`ros2 param get`, `set` and `list`."""

import contextlib
import re
import sys

import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from pkm_nodes.ros2.node import node_names
from pkm_nodes.ros2.shared import (
    FIND_TIMEOUT,
    add_commands,
    add_graph_arguments,
    graph_node,
    ros_node,
    spin_until_done,
    wait_for,
)

TYPES = {  # how `list --param-type` and `get` name a type
    ParameterType.PARAMETER_NOT_SET: ('not set', 'Parameter not set.'),
    ParameterType.PARAMETER_BOOL: ('boolean', 'Boolean value is:'),
    ParameterType.PARAMETER_INTEGER: ('integer', 'Integer value is:'),
    ParameterType.PARAMETER_DOUBLE: ('double', 'Double value is:'),
    ParameterType.PARAMETER_STRING: ('string', 'String value is:'),
    ParameterType.PARAMETER_BYTE_ARRAY: ('byte array', 'Byte values are:'),
    ParameterType.PARAMETER_BOOL_ARRAY: ('boolean array', 'Boolean values are:'),
    ParameterType.PARAMETER_INTEGER_ARRAY: ('integer array', 'Integer values are:'),
    ParameterType.PARAMETER_DOUBLE_ARRAY: ('double array', 'Double values are:'),
    ParameterType.PARAMETER_STRING_ARRAY: ('string array', 'String values are:'),
}


def add_arguments(parser):
    """Add the verbs of `ros2 param`."""
    verbs = add_commands(
        parser,
        {'get': 'Get parameter', 'list': 'Output a list of available parameters', 'set': 'Set parameter'},
    )
    for name, verb in verbs.items():
        add_graph_arguments(verb)
        verb.add_argument('node_name', nargs='?' if name == 'list' else None, help='Name of the ROS node')
        verb.add_argument('--include-hidden-nodes', action='store_true', help='Consider hidden nodes as well')
        if name != 'list':
            verb.add_argument('parameter_name', help='Name of the parameter')
            verb.add_argument(
                '--timeout',
                metavar='N',
                type=float,
                default=FIND_TIMEOUT,
                help='Wait for N seconds until node becomes available (default %(default)s sec)',
            )
    verbs['get'].set_defaults(main=get)
    verbs['get'].add_argument('--hide-type', action='store_true', help='Hide the type information')
    verbs['set'].set_defaults(main=set_)
    verbs['set'].add_argument('value', help='Value of the parameter')
    verbs['list'].set_defaults(main=list_)
    verbs['list'].add_argument(
        '--filter', type=re.compile, help='Only parameters matching the regex expression will be showed.'
    )
    verbs['list'].add_argument(
        '--param-prefixes', nargs='+', default=[], help='Only list parameters with the provided prefixes'
    )
    verbs['list'].add_argument('--param-type', action='store_true', help='Print parameter types with parameter names')


def get(args):
    """Print type and value of one parameter."""
    with _parameters_of(args) as (node, client):
        values = spin_until_done(node, client.get_parameters([args.parameter_name])).values
    if not values:
        return 'Parameter not set'
    value = parameter_value_to_python(values[0])
    if args.hide_type:
        print(value)
    else:
        print(TYPES[values[0].type][1], *([] if value is None else [value]))
    return None


def set_(args):
    """Set one parameter and print the answer of its node; a refusal is no error of the tool, as in ros2cli."""
    parameter = Parameter(name=args.parameter_name, value=_parameter_value(args.value))
    with _parameters_of(args) as (node, client):
        result = spin_until_done(node, client.set_parameters([parameter])).results[0]
    reason = f': {result.reason}' if result.reason else ''
    if result.successful:
        print(f'Set parameter successful{reason}')
    else:
        print(f'Setting parameter failed{reason}', file=sys.stderr)


def list_(args):
    """Print the parameters of one node or of all nodes."""
    wanted = args.node_name and _absolute(args.node_name)
    with graph_node(args) as node:

        def chosen():
            return [n for n in node_names(node, args.include_hidden_nodes) if wanted in (None, n[2])]

        names = wait_for(chosen) if wanted else chosen()
        if wanted and not names:
            return 'Node not found'
        for *_, name in names:
            try:
                _print_parameters(node, name, args)
            except RuntimeError as error:
                print(error, file=sys.stderr)
    return None


def _print_parameters(node, node_name, args):
    client = _client(node, node_name)
    names = sorted(spin_until_done(node, client.list_parameters(prefixes=args.param_prefixes)).result.names)
    if args.filter:
        names = [name for name in names if args.filter.match(name)]
    if names and not args.node_name:
        print(f'{node_name}:')
    types = {}
    if args.param_type and names:
        descriptors = spin_until_done(node, client.describe_parameters(names)).descriptors
        types = {descriptor.name: f' (type: {TYPES[descriptor.type][0]})' for descriptor in descriptors}
    for name in names:
        print(f'  {name}{types.get(name, "")}')


@contextlib.contextmanager
def _parameters_of(args):
    """Yield a node and a client of the parameters of the node that args name."""
    name = _absolute(args.node_name)
    with ros_node(use_sim_time=args.use_sim_time) as node:
        if not wait_for(lambda: name in [n[2] for n in node_names(node, args.include_hidden_nodes)], args.timeout):
            raise RuntimeError('Node not found')
        yield node, _client(node, name)


def _client(node, node_name):
    client = AsyncParameterClient(node, node_name)
    if not client.wait_for_services(FIND_TIMEOUT):
        raise RuntimeError(f'Wait for service timed out waiting for parameter services for node {node_name}')
    return client


def _absolute(node_name):
    return node_name if node_name.startswith('/') else f'/{node_name}'


def _parameter_value(text):
    """Return the ParameterValue of a command-line text; what YAML takes for a date or a mapping is a string."""
    try:
        value = get_parameter_value(text)
    except yaml.YAMLError:
        value = None
    if value is None or not isinstance(value.string_value, str):
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
    return value
