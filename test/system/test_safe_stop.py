"""A cell of separate processes, one of which is killed in the middle of a cycle."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from time import monotonic, sleep

import pytest
import rclpy
from std_srvs.srv import Trigger

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import read_topics
from pkm_core.errors import PkmError
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses

DOMAIN = 62
# refusals while a restarted process is not up, or not yet believed
_NOT_UP = ('not loaded within', 'gives no sign of life', 'did not start within')
PKM = Path(sys.prefix) / 'bin' / 'pkm'


@pytest.fixture
def domain(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def test_killed_controller_is_named_and_the_machine_stops(domain, tmp_path):
    """The bags are readable."""
    cell = CellProcesses('four_dof', 'processes', seed=1, environment='nominal', folder=tmp_path)
    with cell, CellClient() as client:
        client.wait_until_up(cell.check)
        victim = cell.processes['joint_controller_d3']

        def kill_in_the_next_cycle(feedback):
            if feedback.cycle == 1:
                sleep(0.3)  # a cycle of 680 ticks takes about a second
                os.kill(victim.pid, signal.SIGKILL)

        with pytest.raises(PkmError) as refusal:
            client.execute('four_dof_70ms', 5, 'none', cell.check, kill_in_the_next_cycle)
    said = str(refusal.value)
    assert 'joint_controller_d3 has ended with code -9' in said
    assert 'no answer for' in said
    assert said.rstrip().endswith('from joint_controller of d3')

    whole, cut = (read_cycle(path) for path in sorted((tmp_path / 'bags').iterdir()))
    assert len(whole.ticks) == 680
    assert 0 < len(cut.ticks) < 680
    encoder = read_topics(cut.path, ['/pkm/d1/encoder'])['/pkm/d1/encoder']
    assert [sample.tick for sample in encoder] == list(range(encoder[0].tick, encoder[0].tick + len(encoder)))
    # how long it brakes depends on when in its motion the machine missed the answer
    assert abs(encoder[-1].position - encoder[-2].position) < 2e-6, 'it stands at the end of the safe stop: < 4 mm/s'
    events = read_topics(cut.path, ['/pkm/cycle_events'])['/pkm/cycle_events']
    assert any(event.event == CycleEvent.FAULT and 'd3' in event.message for event in events)
    for record in (whole, cut):
        lost = {topic: count - record.recorded[topic] for topic, count in record.expected.items()}
        lost = {topic: count for topic, count in lost.items() if count > 0}
        # a process that is killed while it publishes may have reached the machine and not yet the recorder
        assert lost in ({}, {'/pkm/d3/command': 1} if record is cut else {})


def test_cell_continues_after_restart_and_reset(domain, tmp_path):
    cell = CellProcesses('four_dof', 'processes', seed=1, environment='nominal', folder=tmp_path)
    with cell, CellClient() as client:
        client.wait_until_up(cell.check)
        os.kill(cell.processes['joint_controller_d5'].pid, signal.SIGKILL)
        cell.processes['joint_controller_d5'].wait()
        del cell.processes['joint_controller_d5']
        with pytest.raises(PkmError, match=r"not loaded within .* by joint_controller of \['d5'\]"):
            client.execute('four_dof_70ms', 1, 'none', cell.check, lambda _: None)
        cell.start('joint_controller_d5')
        assert call('/pkm/machine/reset').success
        log = execute_when_up(client, cell)
    assert len(read_cycle(log.bags[-1]).ticks) == 680


def test_machine_killed_in_a_cycle_ends_the_goal(domain, tmp_path):
    """It is silent before DDS forgets it. A restarted machine runs cycles again; the bag names what it lacks."""
    cell = CellProcesses('four_dof', 'processes', seed=1, environment='nominal', folder=tmp_path)
    with cell, CellClient() as client:
        client.wait_until_up(cell.check)
        execute_and_kill('machine', client, cell, r'cycle 2: the machine (that ran it is gone|gives no sign of life)')
        log = execute_when_up(client, cell)
    whole, cut, again = (read_cycle(path) for path in sorted((tmp_path / 'bags').iterdir()))
    assert again.path == log.bags[-1]
    assert len(whole.ticks) == len(again.ticks) == 680
    assert 0 < len(cut.ticks) < 680
    events = read_topics(cut.path, ['/pkm/cycle_events'])['/pkm/cycle_events']
    assert any(event.event == CycleEvent.STOP and event.message.startswith('the machine ') for event in events)
    assert cut.expected['/pkm/d1/encoder'] >= len(cut.ticks)


def test_stopped_machine_is_named_and_its_process_ends(domain, tmp_path):
    """SIGSTOP in a cycle: it is alive and gives no answer. At the end it continues, brakes and leaves in order."""
    cell = CellProcesses('four_dof', 'processes', seed=1, environment='nominal', folder=tmp_path)
    [generator] = [spec for spec in cell.nodes if spec.name == 'trajectory_generator']
    generator.parameters['machine_timeout'] = 5.0

    def stop_in_a_cycle(feedback):
        if feedback.cycle == 1:
            sleep(0.3)
            machine.send_signal(signal.SIGSTOP)

    with cell, CellClient() as client:
        client.wait_until_up(cell.check)
        machine = cell.processes['machine']
        with pytest.raises(PkmError, match='the machine gives no sign of life for'):
            client.execute('four_dof_70ms', 20, 'none', cell.check, stop_in_a_cycle)
    assert machine.returncode == 0


@pytest.mark.slow
def test_cycle_ends_without_its_killed_generator(domain, tmp_path):
    """Cycle numbers continue after its restart."""
    cell = CellProcesses('four_dof', 'processes', seed=1, environment='nominal', folder=tmp_path)
    with cell, CellClient() as client:
        client.wait_until_up(cell.check)
        execute_and_kill('trajectory_generator', client, cell, '')
        log = client.execute('four_dof_70ms', 1, 'none', cell.check, lambda _: None)
    records = [read_cycle(path) for path in sorted((tmp_path / 'bags').iterdir())]
    assert [len(record.ticks) for record in records] == [680] * 3
    assert records[-1].path == log.bags[-1]


def execute_and_kill(name, client, cell, reason):
    """Run five cycles, kill the process `name` in the second one, and start it again when the goal has ended."""

    def kill_in_the_next_cycle(feedback):
        if feedback.cycle == 1:
            sleep(0.3)  # a cycle of 680 ticks takes about a second
            cell.processes[name].send_signal(signal.SIGKILL)

    with pytest.raises(PkmError, match=f'(?s){name} has ended with code -9.*{reason}'):
        client.execute('four_dof_70ms', 5, 'none', cell.check, kill_in_the_next_cycle)
    cell.start(name)


def execute_when_up(client, cell):
    """Run one cycle; repeat until the restarted process is up, which takes a minute on a computer with much else."""
    deadline = monotonic() + 180.0
    while True:
        try:
            return client.execute('four_dof_70ms', 1, 'none', cell.check, lambda _: None)
        except PkmError as refusal:
            if not any(text in str(refusal) for text in _NOT_UP) or monotonic() > deadline:
                raise


def call(name):
    """Call a std_srvs/Trigger service from a node of the test."""
    node = rclpy.create_node('test_safe_stop')
    future = node.create_client(Trigger, name).call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
    node.destroy_node()
    assert future.done(), f'{name} did not answer'
    return future.result()


def test_pkm_stop_brakes_the_running_motion(domain, tmp_path):
    cell = CellProcesses('four_dof', 'composed', seed=1, environment='nominal', folder=tmp_path)
    stops = []

    def stop_once(feedback):
        if not stops:
            stops.append(subprocess.Popen([PKM, 'stop'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))

    with cell, CellClient(session=cell.session) as client:
        client.wait_until_up(cell.check)
        with pytest.raises(PkmError, match='stopped by the service machine/stop'):
            client.execute('four_dof_70ms', 1000, 'none', cell.check, stop_once)
        printed, _ = stops[0].communicate(timeout=60)
        assert stops[0].returncode == 0
        assert printed.startswith('the machine was stopped at tick ')
        assert len(printed.splitlines()) == 1
