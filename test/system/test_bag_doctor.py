"""A recorder killed in the middle of a cycle, and the repair of its bag by `pkm bag-doctor`."""

import json
import os
import signal
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import rclpy
from std_msgs.msg import UInt64

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import raw_messages
from pkm_core.bag.writer import CHUNK_BYTES
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses
from pkm_nodes.runtime.node import reliable

DOMAIN = 64
PKM = Path(sys.prefix) / 'bin' / 'pkm'
SAMPLES = 680  # of four_dof_70ms
# last tick that the recorder has confirmed when it is killed; a chunk of 64 KiB holds some 110
KILL_AT = 250


class Killed(NamedTuple):
    """A bag whose recorder was killed by SIGKILL in the middle of a cycle."""

    bag: Path
    said: str  # by the client
    confirmed: int  # last tick reported by the recorder to the machine


@pytest.fixture(scope='module')
def killed(tmp_path_factory):
    folder = tmp_path_factory.mktemp('cell')
    confirmed = []

    def kill_in_the_middle():
        rclpy.spin_once(node, timeout_sec=0.0)
        recorder = cell.processes['recorder']
        if confirmed and confirmed[-1] >= KILL_AT and recorder.poll() is None:
            os.kill(recorder.pid, signal.SIGKILL)
            recorder.wait()
        cell.check()

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        cell = CellProcesses('four_dof', 'processes', seed=3, environment='nominal', folder=folder)
        with cell, CellClient() as client:
            node = rclpy.create_node('test_bag_doctor')
            node.create_subscription(
                UInt64, '/pkm/recorder/tick', lambda message: confirmed.append(message.data), reliable(1)
            )
            client.wait_until_up(cell.check)
            with pytest.raises(PkmError) as refusal:
                client.execute('four_dof_70ms', 1, 'none', kill_in_the_middle, lambda _: None)
            for _ in range(10):  # the content of the subscription, and some turns without messages
                rclpy.spin_once(node, timeout_sec=0.0)
            node.destroy_node()
    [bag] = (folder / 'bags').iterdir()
    return Killed(bag, str(refusal.value), max(confirmed))


@pytest.fixture(scope='module')
def repaired(killed, module_processes):
    """Return (record of the repaired bag, figures of the verb, its output)."""
    done = module_processes.run(PKM, 'bag-doctor', killed.bag, '--json', 'doctor.json')
    assert done.returncode == 0, done.stderr
    figures = json.loads((module_processes.folder / 'doctor.json').read_text())
    return read_cycle(figures['path']), figures, done.stdout


def test_killed_recorder_leaves_a_bag_without_metadata(killed):
    """The client reports the exit code of the recorder."""
    assert 'recorder has ended with code -9' in killed.said
    assert [path.suffix for path in killed.bag.iterdir()] == ['.mcap']
    with pytest.raises(PkmError, match='pkm bag-doctor'):
        read_cycle(killed.bag)


def test_repaired_bag_holds_the_start_of_the_cycle(repaired):
    """Bit for bit, up to the last intact chunk."""
    record, _, _ = repaired
    machine = load_machine('four_dof')
    trajectory = to_joints(machine, plan(machine, load_motion('four_dof_70ms')))
    simulated = run_cycles(machine, trajectory, load_control(machine), None, cycles=1, seed=3)
    saved = len(record.ticks)
    assert 50 < saved < SAMPLES
    assert record.ticks.tolist() == list(range(saved))
    assert np.array_equal(record.counts, simulated.counts[0, :saved])
    assert np.array_equal(record.voltage, simulated.voltage[0, :saved])


def test_repair_loses_less_than_one_chunk(killed, repaired):
    record, _, _ = repaired
    of_the_tick = [data for topic, _, data, _ in raw_messages(record.path) if topic.endswith(('/encoder', '/command'))]
    bytes_of_a_tick = sum(len(data) + 31 for data in of_the_tick) / len(
        record.ticks
    )  # 31: overhead of a message in MCAP
    # a chunk ends with the message that fills it
    assert (killed.confirmed - record.ticks[-1]) * bytes_of_a_tick < CHUNK_BYTES + bytes_of_a_tick


def test_doctor_reports_saved_messages_and_missing_ticks(killed, repaired):
    record, figures, printed = repaired
    assert record.path == killed.bag.with_name(f'{killed.bag.name}_repaired')
    for topic, ranges in figures['missing'].items():
        assert ranges == [[figures['saved'][topic], SAMPLES - 1]]
        assert record.expected[topic] == SAMPLES
        assert f'{ranges[0][0]} to {SAMPLES - 1}' in printed
    assert len(figures['missing']) == 8
    assert figures['saved'] == record.recorded
    assert f'{sum(figures["saved"].values())} messages are in {record.path}' in printed


def test_second_repair_and_repair_of_intact_bag_do_nothing(killed, repaired, processes):
    again = processes.run(PKM, 'bag-doctor', killed.bag)
    assert again.returncode == 1
    assert again.stderr == f'pkm: {repaired[0].path}: exists and is not overwritten\n'
    whole = processes.run(PKM, 'bag-doctor', repaired[0].path)
    assert whole.returncode == 0
    assert 'is complete; nothing to repair' in whole.stdout


@pytest.mark.parametrize('content', ['nothing', 'text'])
def test_path_without_a_bag_is_refused_in_one_line(processes, content):
    folder = processes.folder / 'bag'
    folder.mkdir()
    if content == 'text':
        (folder / 'bag.mcap').write_text('this is no bag')
    done = processes.run(PKM, 'bag-doctor', folder)
    assert done.returncode == 1
    assert 'not a bag of this cell' in done.stderr
    assert done.stderr.count('\n') == 1
