"""A server that leaves the graph without an answer: its clients are answered."""

import pytest
import rclpy
from rclpy.action import ActionServer

from pkm_core.errors import PkmError
from pkm_interfaces.action import ExecuteMotion
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.graph import NAMESPACE


def test_client_is_told_that_the_idle_server_has_left(monkeypatch):
    """As after kill -9 of trajectory_generator, when DDS forgets it: 20 s later there, at once here."""
    monkeypatch.setenv('ROS_DOMAIN_ID', '117')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    context.init()
    server = rclpy.create_node('trajectory_generator', namespace=NAMESPACE, context=context)
    idle = ActionServer(server, ExecuteMotion, 'execute_motion', lambda _: None)  # never served
    looks = []

    def check():
        looks.append(client._client.server_is_ready())
        if sum(looks) == 10:  # the goal has been sent: since then the client has waited for its answer
            idle.destroy()
            server.destroy_node()
            context.shutdown()

    named = 'execute_motion: its server /pkm/trajectory_generator was killed'
    with CellClient() as client, pytest.raises(PkmError, match=named):
        client.execute('four_dof_70ms', 1, 'none', check, lambda _: None)
