"""A jog in a cell of separate processes, whose trajectory source is killed while the platform moves."""

import os
import signal

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TwistStamped

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.repair import repair
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses

DOMAIN = 76


@pytest.fixture
def commander(monkeypatch):
    """Return a node that streams 2 mm/s upwards and keeps the cycle events."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    context.init(domain_id=DOMAIN)
    node = rclpy.create_node('commander', context=context)
    node.heard = []
    node.create_subscription(CycleEvent, '/pkm/cycle_events', node.heard.append, 100)
    velocity = node.create_publisher(TwistStamped, '/pkm/jog', 10)
    message = TwistStamped()
    message.twist.linear.z = 2e-3
    node.create_timer(0.01, lambda: velocity.publish(message))
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    node.serve = lambda: executor.spin_once(timeout_sec=0.1)
    yield node
    node.destroy_node()
    context.shutdown()


def test_jog_of_a_killed_generator_stops_and_is_one_bag(commander, tmp_path):
    """The machine drives the stop of the last piece; the commander streams on, and nothing else moves."""
    cell = CellProcesses('four_dof', 'processes', seed=1, environment='nominal', folder=tmp_path)
    with cell, CellClient() as client:
        client.wait_until_up(cell.check)

        def serve_until(kind, number=1, **fields):
            wanted = {'event': kind, **fields}
            while True:
                found = [e for e in commander.heard if all(getattr(e, n) == value for n, value in wanted.items())]
                if len(found) >= number:
                    return found[-1]
                cell.check()
                commander.serve()

        cycle = serve_until(CycleEvent.EXTENDED, 12).cycle  # the first one, unless this computer does much else
        victim = cell.processes.pop('trajectory_generator')
        os.kill(victim.pid, signal.SIGKILL)
        victim.wait()
        finished = serve_until(CycleEvent.FINISHED, cycle=cycle)
        serve_until(CycleEvent.RECORDED, cycle=cycle)
        assert commander.heard[-1].cycle == cycle
    [path] = (tmp_path / 'bags').glob(f'jog_{cycle:04d}_*')
    record = read_cycle(path)
    assert record.is_whole
    assert (record.motion, len(record.ticks)) == ('jog', finished.samples)
    assert repair(path) is None
    speed = np.diff(record.pose_reference[:, 2]) / record.sample_time
    assert speed.max() == pytest.approx(2e-3)
    assert np.abs(speed[-38:]).max() < 1e-9, 'it rests in the last 19 ms'
    assert np.abs(record.error).max() < 50e-6
