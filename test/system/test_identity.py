"""A cell beside another one: neither is measured, moved or stopped as if it were the other."""

import json
import sys
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.action import ActionClient
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import UInt64

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.errors import BagError, PkmError
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleEvent, EncoderSample, MotorCommand, SampledTrajectory
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses
from pkm_nodes.clients.own_bags import read_own
from pkm_nodes.runtime.node import RCLError

DOMAIN = 126
PKM = Path(sys.prefix) / 'bin' / 'pkm'
TIMEOUT = 90.0  # [s, wall] a start takes seconds; the rest is reserve
NAMED = 'a cell runs in /pkm: node /pkm/machine, host '


@pytest.fixture(scope='module')
def cell(tmp_path_factory):
    """Return a running cell that has run one cycle; the test process is in its domain."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        cell = CellProcesses('four_dof', 'composed', seed=1, environment='nominal', folder=tmp_path_factory.mktemp('a'))
        with cell, CellClient(session=cell.session) as client:
            client.wait_until_up(cell.check)
            cell.client, cell.log = client, client.execute('four_dof_70ms', 1, 'none', cell.check, lambda _: None)
            yield cell


@pytest.mark.parametrize('verb', ['run', 'identify-cell'])
def test_verb_beside_a_running_cell_starts_nothing(cell, verb, processes):
    """The figures of the other cell used to be filed under the options of this one."""
    out = processes.folder / 'out'
    done = processes.run(PKM, verb, '--seed', 7, '--environment', 'hard', '--out', out)
    assert done.returncode == 1
    assert NAMED in done.stderr
    assert f'session {cell.session}' in done.stderr
    assert not (out / 'results.json').exists()
    assert not list(out.glob('bags/*'))


def test_second_cell_by_hand_ends_with_one_line(cell, processes):
    executable = cell.command('cell')
    done = processes.run(*executable, '--ros-args', '-p', f'folder:={processes.folder}/bags')
    assert done.returncode == 1
    assert done.stderr.startswith(NAMED)
    assert len(done.stderr.splitlines()) == 1


def test_goal_for_another_session_moves_nothing(cell, tmp_path):
    before = sorted(path.name for path in cell.bags.iterdir())
    cell.client._session, own = 'sother', cell.client._session
    try:
        with pytest.raises(PkmError, match=f"for the cell of session 'sother'; this cell has session '{own}'"):
            cell.client.execute('four_dof_70ms', 1, 'none', cell.check, lambda feedback: None)
    finally:
        cell.client._session = own
    assert sorted(path.name for path in cell.bags.iterdir()) == before


def test_bag_names_its_session_seed_and_environment(cell):
    (record,) = read_own(cell.log.bags, cell)
    assert record.facts['session'] == cell.session
    machine = json.loads(record.facts['parameters'])['machine']
    assert (machine['seed'], machine['environment']) == (1, 'nominal')


@pytest.mark.parametrize(
    ('name', 'value', 'refusal'),
    [
        ('session', 'sother', r"session 's\w+'; expected 'sother'"),
        ('seed', 7, 'seed 1; expected 7'),
        ('environment', 'hard', "environment 'nominal'; expected 'hard'"),
        ('bags', Path('/elsewhere'), r"folder '.*/bags'; expected '/elsewhere'"),
    ],
)
def test_bag_of_another_cell_gives_no_result(cell, name, value, refusal, monkeypatch):
    assert read_cycle(cell.log.bags[0]).is_whole
    monkeypatch.setattr(cell, name, value)
    with pytest.raises(BagError, match=f'not recorded by this cell: .*{refusal}'):
        list(read_own(cell.log.bags, cell))


def test_rogue_messages_end_no_node_and_move_nothing(cell):
    """Short and big-endian messages of the tick, a negative time, text that is no UTF-8, unknown events, 200 goals."""
    context = rclpy.Context()
    context.init(domain_id=DOMAIN)
    rogue = rclpy.create_node('rogue', namespace='/pkm', context=context)
    kinds = {'d1/command': MotorCommand, 'd3/encoder': EncoderSample, 'cycle_events': CycleEvent}
    kinds |= {'/clock': ClockMessage, 'joint_trajectory': SampledTrajectory, 'recorder/tick': UInt64}
    publishers = {topic: rogue.create_publisher(kind, topic, 100) for topic, kind in kinds.items()}
    sleep(2.0)  # discovery
    for publisher in publishers.values():
        for data in (b'\0\1\0\0', b'\0\0\0\0' + bytes(40), b'\0\1\0\0' + b'\xff' * 8, b'\0\1\0\0' + bytes(6)):
            with suppress(RCLError):  # DDS sends nothing that is larger than the type
                publisher.publish(data)
    publishers['/clock'].publish(ClockMessage(clock=Time(sec=-5)))
    for event in range(256):
        publishers['cycle_events'].publish(CycleEvent(event=event, source='d1', cycle=2**32 - 1, session='sother'))
    goals = ActionClient(rogue, ExecuteMotion, 'execute_motion')
    assert goals.wait_for_server(timeout_sec=20.0)
    for _ in range(200):
        goals.send_goal_async(ExecuteMotion.Goal(session='sother', motion='/etc/passwd', cycles=1))
    sleep(1.0)
    cell.check()
    goals.destroy()
    rogue.destroy_node()
    context.shutdown()
    log = cell.client.execute('four_dof_70ms', 1, 'none', cell.check, lambda feedback: None)
    (record,) = read_own(log.bags, cell)
    assert record.is_whole
    (first,) = read_own(cell.log.bags, cell)
    assert record.cycle == first.cycle + 1


def test_of_two_cells_started_at_once_one_runs(processes, tmp_path):
    """Both are in one domain of their own and get the lock or its holder's name."""
    processes.environment['ROS_DOMAIN_ID'] = str(DOMAIN + 1)
    executable = [str(Path(sys.prefix) / 'lib' / 'pkm_nodes' / 'cell')]
    started = [
        processes.start(*executable, '--ros-args', '-p', f'folder:={tmp_path}/bags_{name}', log=name)
        for name in ('a', 'b')
    ]
    deadline = monotonic() + TIMEOUT
    while all(process.poll() is None for process in started) and monotonic() < deadline:
        sleep(0.1)
    (ended,) = (process for process in started if process.poll() is not None)
    (survivor,) = (process for process in started if process is not ended)
    assert ended.returncode == 1
    log = (processes.folder / 'ab'[started.index(ended)]).read_text()
    assert NAMED in log
    assert f'pid {survivor.pid}, domain {DOMAIN + 1}' in log
