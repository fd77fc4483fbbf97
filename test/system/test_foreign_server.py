"""A client of a cell beside the action server of another cell: it sends no goal that two cells would take."""

from time import monotonic

import pytest
import rclpy
from rclpy.action import ActionServer

from pkm_core.errors import PkmError
from pkm_interfaces.action import ExecuteMotion
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


def test_server_of_another_user_is_not_taken_for_the_own(serve):
    """DDS does not tell the names of its nodes; the own server comes later, and the client waits for it."""
    serve('_NODE_NAME_UNKNOWN_')
    begin, started = monotonic(), []

    def check():
        if not started and monotonic() > begin + 1.0:
            started.append(serve('trajectory_generator'))

    with CellClient() as client:
        client._spin_until(client._client.server_is_ready, lambda: None, 20.0, 'the foreign server')
        begin = monotonic()
        with pytest.raises(PkmError, match='one without a name, of another user of this computer, /pkm/trajectory_g'):
            client.wait_until_up(check)
    assert started
