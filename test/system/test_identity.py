"""A cell beside another one: neither is measured, moved or stopped as if it were the other."""

import json
import sys
from pathlib import Path
from time import monotonic, sleep

import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.errors import BagError, PkmError
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses
from pkm_nodes.clients.own_bags import read_own

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
            client.log = client.execute('four_dof_70ms', 1, 'none', cell.check, lambda feedback: None)
            cell.client = client
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
    (record,) = read_own(cell.client.log.bags, cell)
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
    assert read_cycle(cell.client.log.bags[0]).is_whole
    monkeypatch.setattr(cell, name, value)
    with pytest.raises(BagError, match=f'not recorded by this cell: .*{refusal}'):
        read_own(cell.client.log.bags, cell)


def test_of_two_cells_started_at_once_one_runs(processes, tmp_path):
    """Both are in one domain of their own and get the lock or its holder's name."""
    processes.environment['ROS_DOMAIN_ID'] = str(DOMAIN + 1)
    executable = [str(Path(sys.prefix) / 'lib' / 'pkm_nodes' / 'cell')]
    started = [
        processes.start(*executable, '--ros-args', '-p', f'folder:={tmp_path}/{name}', log=name) for name in ('a', 'b')
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
