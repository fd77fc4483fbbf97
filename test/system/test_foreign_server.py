"""A client of a cell beside the action server of another cell: it sends no goal that two cells would take."""

import pytest
import rclpy
from rclpy.action import ActionServer

from pkm_core.errors import PkmError
from pkm_interfaces.action import ExecuteMotion
from pkm_nodes.clients import cell_client
from pkm_nodes.clients.cell_client import CellClient

DOMAIN = 129


@pytest.fixture
def serve(monkeypatch):
    """Return a function that starts a node of another process with an action server execute_motion."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    made = []

    def serve(name):
        context = rclpy.Context()
        context.init(domain_id=DOMAIN)
        node = rclpy.create_node(name, namespace='/pkm', context=context)
        made.append((ActionServer(node, ExecuteMotion, 'execute_motion', lambda _: None), node, context))

    yield serve
    for server, node, context in made:
        server.destroy()
        node.destroy_node()
        context.shutdown()


def test_second_server_of_motions_is_named(serve):
    serve('trajectory_generator')
    serve('intruder')
    with CellClient() as client:
        client._spin_until(lambda: len(client._servers()) == 2, lambda: None, 20.0, 'both servers')
        with pytest.raises(PkmError) as refusal:
            client.wait_until_up(lambda: None)
    assert str(refusal.value).startswith(
        '/pkm: 2 nodes offer execute_motion, /pkm/intruder, /pkm/trajectory_generator; allowed: 1. Stop the other cell'
    )


def test_server_of_another_user_is_not_taken_for_the_own(serve, monkeypatch):
    """DDS does not tell the names of its nodes; the own server comes later."""
    monkeypatch.setattr(cell_client, '_UP_TIMEOUT', 1.0)
    serve('_NODE_NAME_UNKNOWN_')
    with CellClient() as client:
        client._spin_until(client._client.server_is_ready, lambda: None, 20.0, 'the foreign server')
        with pytest.raises(PkmError, match='the cell did not offer execute_motion within 1 s'):
            client.wait_until_up(lambda: None)
        serve('trajectory_generator')
        client._spin_until(lambda: any(client._servers()), lambda: None, 20.0, 'the own server')
        with pytest.raises(PkmError, match='one without a name, of another user of this computer, /pkm/trajectory_g'):
            client.wait_until_up(lambda: None)
