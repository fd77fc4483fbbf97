"""`ros2 param get`, `set` and `list`."""

import argparse
import contextlib
import re
import sys
import time

import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from pkm_nodes.ros2.node import node_names
from pkm_nodes.ros2.shared import (
    FIND_TIMEOUT,
    add_commands,
    add_graph_arguments,
    ros_node,
    spin_until_done,
)
from pkm_nodes.runtime.discovery import wait_for

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
                default=1,
                help='Wait for N seconds until node becomes available (default %(default)s sec)',
            )
    verbs['get'].set_defaults(main=get)
    verbs['get'].add_argument('--hide-type', action='store_true', help='Hide the type information')
    verbs['set'].set_defaults(main=set_)
    verbs['set'].add_argument('value', help='Value of the parameter')
    verbs['list'].set_defaults(main=list_)
    verbs['list'].add_argument(
        '--filter', type=_pattern, help='Only parameters matching the regex expression will be showed.'
    )
    verbs['list'].add_argument(
        '--param-prefixes', nargs='+', default=[], help='Only list parameters with the provided prefixes'
    )
    verbs['list'].add_argument('--param-type', action='store_true', help='Print parameter types with parameter names')


def get(args):
    """Print type and value of one parameter."""
    with _parameters_of(args) as (node, client):
        values = _answer(node, client.get_parameters([args.parameter_name])).values
    if not values:
        return 'Parameter not set'
    value = parameter_value_to_python(values[0])
    if args.hide_type:
        print(value)
    else:
        print(TYPES[values[0].type][1], *([] if value is None else [value]))
    return None


def set_(args):
    """Set one parameter and print the reply of its node; a refusal does not change the exit code, as in ros2cli."""
    parameter = Parameter(name=args.parameter_name, value=_parameter_value(args.value))
    with _parameters_of(args) as (node, client):
        result = _answer(node, client.set_parameters([parameter])).results[0]
    reason = f': {result.reason}' if result.reason else ''
    if result.successful:
        print(f'Set parameter successful{reason}')
    else:
        print(f'Setting parameter failed{reason}', file=sys.stderr)


def list_(args):
    """Print the parameters of one node or of all nodes."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        if args.node_name:
            names = [_find_node(node, args, args.spin_time)]
        else:
            time.sleep(args.spin_time)
            names = [name for *_, name in node_names(node, args.include_hidden_nodes)]
        for name in names:
            try:
                _print_parameters(node, name, args)
            except RuntimeError as error:
                print(f'{name}: {error}', file=sys.stderr)


def _print_parameters(node, node_name, args):
    client = _client(node, node_name)
    names = sorted(_answer(node, client.list_parameters(prefixes=args.param_prefixes)).result.names)
    if args.filter:
        names = [name for name in names if args.filter.match(name)]
    if names and not args.node_name:
        print(f'{node_name}:')
    types = {}
    if args.param_type and names:
        descriptors = _answer(node, client.describe_parameters(names)).descriptors
        types = {descriptor.name: f' (type: {TYPES[descriptor.type][0]})' for descriptor in descriptors}
    for name in names:
        print(f'  {name}{types.get(name, "")}')


@contextlib.contextmanager
def _parameters_of(args):
    """Yield a node and a parameter client of the node named in `args`."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        yield node, _client(node, _find_node(node, args, max(args.spin_time, args.timeout)))


def _find_node(node, args, timeout):
    """Return the full name of the node named in `args` as soon as it is in the graph."""
    name = f'/{args.node_name.removeprefix("/")}'
    if not wait_for(lambda: name in [full for *_, full in node_names(node, args.include_hidden_nodes)], timeout):
        raise RuntimeError('Node not found')
    return name


def _client(node, node_name):
    client = AsyncParameterClient(node, node_name)
    if not client.wait_for_services(FIND_TIMEOUT):
        raise RuntimeError(f'Wait for service timed out waiting for parameter services for node {node_name}')
    return client


def _answer(node, future):
    return spin_until_done(node, future, FIND_TIMEOUT)


def _parameter_value(text):
    """Return the ParameterValue of a command-line text; a value without ROS type, such as a YAML date, is a string."""
    checked = ParameterValue(check_fields=True)
    try:
        guess = get_parameter_value(text)
        for name in guess.get_fields_and_field_types():
            setattr(checked, name, getattr(guess, name))
    except (yaml.YAMLError, AssertionError, OverflowError):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
    return checked


def _pattern(text):
    try:
        return re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f"'{text}' is not a regular expression: {error}") from error
