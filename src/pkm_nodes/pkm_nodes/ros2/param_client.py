"""What the verbs of `ros2 param` share: names of the types, and clients of the parameter services of a node."""

import contextlib

from rcl_interfaces.msg import ParameterType
from rclpy.parameter_client import AsyncParameterClient

from pkm_nodes.ros2.node import node_names
from pkm_nodes.ros2.shared import FIND_TIMEOUT, ros_node, spin_until_done
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


@contextlib.contextmanager
def parameters_of(args):
    """Yield a node and a parameter client of the node named in `args`."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        yield node, client_of(node, find_node(node, args, max(args.spin_time, args.timeout)))


def find_node(node, args, timeout):
    """Return the full name of the node named in `args` as soon as it is in the graph."""
    name = f'/{args.node_name.removeprefix("/")}'
    if not wait_for(lambda: name in [full for *_, full in node_names(node, args.include_hidden_nodes)], timeout):
        raise RuntimeError('Node not found')
    return name


def client_of(node, node_name):
    """Return a parameter client of the node `node_name`, whose services are there."""
    client = AsyncParameterClient(node, node_name)
    if not client.wait_for_services(FIND_TIMEOUT):
        raise RuntimeError(f'Wait for service timed out waiting for parameter services for node {node_name}')
    return client


def answer(node, future):
    """Return the answer to a request of a parameter client."""
    return spin_until_done(node, future, FIND_TIMEOUT)
