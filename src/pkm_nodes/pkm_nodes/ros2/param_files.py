"""`ros2 param describe`, `dump` and `load`."""

import sys

import yaml
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python

from pkm_nodes.ros2.param_client import TYPES, answer, parameters_of


def add_arguments(verbs):
    """Add the arguments of these verbs to their parsers, {name: parser}."""
    verbs['describe'].set_defaults(main=describe)
    verbs['describe'].add_argument('parameter_names', nargs='+', help='Names of the parameters')
    verbs['dump'].set_defaults(main=dump)
    verbs['load'].set_defaults(main=load)
    verbs['load'].add_argument('parameter_file', help='Parameter file')
    wildcard = "Do not load parameters in the '/**' namespace into the node"
    verbs['load'].add_argument('--no-use-wildcard', action='store_true', help=wildcard)


def describe(args):
    """Print type, description and constraints of parameters."""
    with parameters_of(args) as (node, client):
        descriptors = answer(node, client.describe_parameters(args.parameter_names)).descriptors
    for descriptor in descriptors:
        print(f'Parameter name: {descriptor.name}\n  Type: {TYPES[descriptor.type][0]}')
        if descriptor.description:
            print(f'  Description: {descriptor.description}')
        print('  Constraints:')
        if descriptor.read_only:
            print('    Read only: true')
        for bounds in [*descriptor.floating_point_range, *descriptor.integer_range][:1]:
            print(f'    Min value: {bounds.from_value}\n    Max value: {bounds.to_value}')
            if bounds.step:
                print(f'    Step: {bounds.step}')
        if descriptor.additional_constraints:
            print(f'    Additional constraints: {descriptor.additional_constraints}')


def dump(args):
    """Print all parameters of a node as a parameter file."""
    with parameters_of(args) as (node, client):
        names = sorted(answer(node, client.list_parameters()).result.names)
        values = answer(node, client.get_parameters(names)).values
    content = {}
    for name, value in zip(names, map(parameter_value_to_python, values), strict=False):
        *sections, key = name.split('.')
        place = content
        for section in sections:
            place = place.setdefault(section, {})
        place[key] = list(value) if hasattr(value, 'typecode') else value
    full_name = f'/{args.node_name.removeprefix("/")}'
    print(yaml.safe_dump({full_name: {'ros__parameters': content}}, default_flow_style=False))


def load(args):
    """Set the parameters of a file and print the reply to each; a refusal does not change the exit code, as above."""
    name, wildcard = f'/{args.node_name.removeprefix("/")}', not args.no_use_wildcard
    try:
        found = parameter_dict_from_yaml_file(args.parameter_file, wildcard, target_nodes=[name])
    except RuntimeError as error:
        if not (wildcard and 'does not contain' in str(error)):
            raise
        found = parameter_dict_from_yaml_file(args.parameter_file, wildcard)  # of '/**' alone
    except (yaml.YAMLError, AttributeError, TypeError) as error:
        return f'{args.parameter_file}: not a parameter file: {" ".join(str(error).split())[:200]}'
    with parameters_of(args) as (node, client):
        results = answer(node, client.set_parameters(list(found.values()))).results
    for parameter, result in zip(found.values(), results, strict=True):
        reason = f': {result.reason}' if result.reason else ''
        outcome = 'successful' if result.successful else 'failed'
        print(f'Set parameter {parameter.name} {outcome}{reason}', file=sys.stdout if result.successful else sys.stderr)
    return None
