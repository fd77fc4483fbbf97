"""Help of the executables: purpose, parameters and endpoints of a node, read from the node itself."""

import importlib
import inspect
import os
from contextlib import chdir
from tempfile import TemporaryDirectory

import rclpy
from rclpy.action import graph
from rclpy.parameter import Parameter

from pkm_nodes.parts.loaded_config import CONFIG_HASH
from pkm_nodes.runtime.node import PkmNode

_NAMESPACE, _USUAL = '/help', '/pkm'
# of ROS, and one that a node sets itself
_NOT_SETTABLE = ('use_sim_time', 'start_type_description_service', 'qos_overrides.', CONFIG_HASH)
_OF_EVERY_NODE = ('/rosout', '/parameter_events', '/clock')
# ends of the names of services that every node has
_OF_ROS = (
    *('/describe_parameters', '/get_parameters', '/get_parameter_types', '/list_parameters', '/set_parameters'),
    *('/set_parameters_atomically', '/get_type_description'),
)


def parameter_rows(node):
    """Return [(name, type, default, description)] of the parameters of `node` that can be set."""
    return [
        (
            parameter.name,
            Parameter.Type(node.describe_parameter(parameter.name).type).name.lower(),
            f'{parameter.value}' if parameter.value != '' else "''",
            node.describe_parameter(parameter.name).description,
        )
        for parameter in node.get_parameters(node.list_parameters([], 0).names)
        if not parameter.name.startswith(_NOT_SETTABLE)
    ]


def show(executable):
    """Print the help of `executable`. The node is started briefly, without contact to other processes."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    module = importlib.import_module(f'pkm_nodes.nodes.{executable}')
    rclpy.init(args=['--ros-args', '-r', f'__ns:={_NAMESPACE}', '-r', f'/clock:={_NAMESPACE}/clock'])
    try:
        with TemporaryDirectory() as folder, chdir(folder):  # the recorder creates its folder
            node = node_type(module)()
            text = help_text(executable, inspect.getdoc(module), [node, *getattr(node, 'parts', ())])
            for each in (node, *getattr(node, 'parts', ())):
                each.destroy_node()
    finally:
        rclpy.shutdown()
    print(text)


def node_type(module):
    """Return the class of the node in the `module` of an executable."""
    return next(
        each
        for each in vars(module).values()
        if isinstance(each, type) and issubclass(each, PkmNode) and each.__module__ == module.__name__
    )


def help_text(executable, purpose, nodes):
    """Return the help of `executable` with the docstring `purpose`: parameters of its first node, topics of all."""
    rows = parameter_rows(nodes[0])
    widths = [max(map(len, column)) for column in zip(*(row[:3] for row in rows), strict=True)]
    lines = [
        purpose,
        '',
        f'usage: ros2 run pkm_nodes {executable} [--ros-args [-p NAME:=VALUE ...] [-r __ns:=/NAMESPACE]]',
        '',
        'parameters: name, type, default, meaning',
        *('  ' + '  '.join([*map(str.ljust, row[:3], widths), row[3]]).rstrip() for row in rows),
    ]
    for title, endpoints in _endpoints(nodes).items():
        if endpoints:
            lines += ['', f'{title}:', *(f'  {name} [{types}]' for name, types in sorted(endpoints.items()))]
    if hasattr(nodes[0], 'specs'):
        names = ', '.join(spec.name for spec in nodes[0].specs)
        lines += ['', f'nodes, whose topics and parameters their own help lists: {names}']
    return '\n'.join(lines)


def _endpoints(nodes):
    """Return {title: {name: types}} of the endpoints of `nodes`."""
    found = {}
    for node in nodes:
        own = (node.get_name(), node.get_namespace())
        for title, names in (
            ('topics published', node.get_publisher_names_and_types_by_node(*own)),
            ('topics subscribed', node.get_subscriber_names_and_types_by_node(*own)),
            ('services', node.get_service_names_and_types_by_node(*own)),
            ('actions', graph.get_action_server_names_and_types_by_node(node, *own)),
        ):
            found.setdefault(title, {}).update(
                {
                    f'{_USUAL}{name.removeprefix(_NAMESPACE)}' if name.startswith(_NAMESPACE) else name: ', '.join(
                        types
                    )
                    for name, types in names
                    if not name.endswith((*_OF_EVERY_NODE, *_OF_ROS)) and '/_action/' not in name
                }
            )
    return found
