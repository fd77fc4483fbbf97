"""`ros2 param get`, `set` and `list`; `describe`, `dump` and `load` are in param_files.py."""

import argparse
import re
import sys
import time

import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rclpy.parameter import get_parameter_value, parameter_value_to_python

from pkm_nodes.ros2 import param_files
from pkm_nodes.ros2.node import node_names
from pkm_nodes.ros2.param_client import TYPES, answer, client_of, find_node, parameters_of
from pkm_nodes.ros2.shared import add_commands, add_graph_arguments, ros_node


def add_arguments(parser):
    """Add the verbs of `ros2 param`."""
    verbs = add_commands(
        parser,
        {
            'describe': 'Show descriptive information about declared parameters',
            'dump': 'Show all of the parameters of a node in a YAML file format',
            'get': 'Get parameter',
            'list': 'Output a list of available parameters',
            'load': 'Load parameter file for a node',
            'set': 'Set parameter',
        },
    )
    for name, verb in verbs.items():
        add_graph_arguments(verb)
        verb.add_argument('node_name', nargs='?' if name == 'list' else None, help='Name of the ROS node')
        verb.add_argument('--include-hidden-nodes', action='store_true', help='Consider hidden nodes as well')
        if name in ('get', 'set'):
            verb.add_argument('parameter_name', help='Name of the parameter')
        if name != 'list':
            verb.add_argument(
                '--timeout',
                metavar='N',
                type=float,
                default=1,
                help='Wait for N seconds until node becomes available (default %(default)s sec)',
            )
    param_files.add_arguments(verbs)
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
    with parameters_of(args) as (node, client):
        values = answer(node, client.get_parameters([args.parameter_name])).values
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
    with parameters_of(args) as (node, client):
        result = answer(node, client.set_parameters([parameter])).results[0]
    reason = f': {result.reason}' if result.reason else ''
    if result.successful:
        print(f'Set parameter successful{reason}')
    else:
        print(f'Setting parameter failed{reason}', file=sys.stderr)


def list_(args):
    """Print the parameters of one node or of all nodes."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        if args.node_name:
            names = [find_node(node, args, args.spin_time)]
        else:
            time.sleep(args.spin_time)
            names = [name for *_, name in node_names(node, args.include_hidden_nodes)]
        for name in names:
            try:
                _print_parameters(node, name, args)
            except RuntimeError as error:
                print(f'{name}: {error}', file=sys.stderr)


def _print_parameters(node, node_name, args):
    client = client_of(node, node_name)
    names = sorted(answer(node, client.list_parameters(prefixes=args.param_prefixes)).result.names)
    if args.filter:
        names = [name for name in names if args.filter.match(name)]
    if names and not args.node_name:
        print(f'{node_name}:')
    types = {}
    if args.param_type and names:
        descriptors = answer(node, client.describe_parameters(names)).descriptors
        types = {descriptor.name: f' (type: {TYPES[descriptor.type][0]})' for descriptor in descriptors}
    for name in names:
        print(f'  {name}{types.get(name, "")}')


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
