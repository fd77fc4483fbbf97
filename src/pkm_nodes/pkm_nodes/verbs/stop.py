"""`pkm stop`: brake the machine now."""

import os

import typer

from pkm_core.errors import PkmError
from pkm_core.verbs.options import NamespaceOption
from pkm_nodes.graph import NAMESPACE, namespace_of
from pkm_nodes.runtime.discovery import discover_on_this_computer

# [s, wall] to find the service and to get its answer
_TIMEOUT = 10.0


def stop(namespace: NamespaceOption = NAMESPACE):
    """
    Brake the machine of a running cell at once; no cycle starts before machine/reset.

    A running cycle ends with a FAULT event that has the reason, and the goal is aborted. Between cycles the next one is
    refused. The exit code is 1 if no machine runs in the namespace.

    Example: `pkm stop`
    """
    discover_on_this_computer()
    import rclpy
    from std_srvs.srv import Trigger

    namespace = namespace_of(namespace)
    rclpy.init()
    try:
        # hidden and without services of its own: the recorder asks every other node for its parameters
        node = rclpy.create_node('_pkm_stop', namespace=namespace, start_parameter_services=False)
        client = node.create_client(Trigger, 'machine/stop')
        if not client.wait_for_service(_TIMEOUT):
            domain = os.environ.get('ROS_DOMAIN_ID', '0')
            raise PkmError(f'{client.srv_name}: no machine offers it in ROS domain {domain} within {_TIMEOUT:g} s')
        answer = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(node, answer, timeout_sec=_TIMEOUT)
        if not answer.done():
            raise PkmError(f'{client.srv_name}: no answer within {_TIMEOUT:g} s')
        typer.echo(answer.result().message)
    finally:
        rclpy.try_shutdown()
