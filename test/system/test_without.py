"""A cell without some nodes: it names the missing ones, and other nodes replace them."""

import sys
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles
from pkm_nodes.clients import cell_client as module
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses

DOMAIN = 211
PKM = Path(sys.prefix) / 'bin' / 'pkm'
ROS2 = Path(__file__).parents[2] / 'bringup_scripts' / 'ros2'
LEFT_OUT = ('machine', 'joint_controller_d3', 'inverse_kinematics', 'learning')


@pytest.mark.parametrize('arrangement', ['composed', pytest.param('processes', marks=pytest.mark.slow)])
def test_nodes_started_by_hand_complete_the_cell(processes, tmp_path, arrangement):
    """The printed commands start them; the bits are those of the whole cell."""
    words = [word for name in LEFT_OUT for word in ('--without', name)]
    options = ('--cycles', 2, '--law', 'fourier', '--seed', 5, '--arrangement', arrangement)
    run = processes.start(PKM, 'run', *options, *words, '--out', tmp_path / 'out', log='run')
    said, deadline = processes.folder / 'run', monotonic() + 60.0
    while said.read_text().count('start one, or the original: ') < len(LEFT_OUT):
        assert run.poll() is None, said.read_text()
        assert monotonic() < deadline, said.read_text()
        sleep(0.1)
    assert 'joint_controller_d3: no replacement offers /pkm/d3/command; start one' in said.read_text()
    for number, line in enumerate(line for line in said.read_text().splitlines() if 'start one' in line):
        command = line.partition('or the original: ros2 ')[2]
        processes.start('bash', '-c', f'exec {ROS2} {command}', log=f'other_{number}')
    assert run.wait(timeout=200) == 0, said.read_text()
    assert ' 0 lost' in said.read_text()

    machine = load_machine('four_dof')
    trajectory = to_joints(machine, plan(machine, load_motion('four_dof_70ms')))
    gains = load_control(machine)
    expected = run_cycles(machine, trajectory, gains, make_law('fourier', machine, gains), cycles=2, seed=5)
    for number, path in enumerate(sorted((tmp_path / 'out' / 'bags').iterdir())):
        assert np.array_equal(read_cycle(path).counts, expected.counts[number])


def test_cell_with_a_missing_node_names_it(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setattr(module, '_PATIENCE', 0.1)
    monkeypatch.setattr(module, '_UP_TIMEOUT', 0.1)
    options = {'seed': 1, 'environment': 'nominal', 'folder': tmp_path, 'without': ['joint_controller_d7']}
    said = []
    with (
        CellProcesses('four_dof', 'composed', **options) as cell,
        CellClient() as client,
        pytest.raises(PkmError, match=r'no replacement offers /pkm/d7/command.*\nno replacement within 0 s'),
    ):
        client.wait_for_others(cell, said.append)
    assert said[0].endswith('-p machine:=four_dof -p control:=robust -p joint:=d7')


def test_unknown_node_is_refused_with_the_known_ones(processes):
    done = processes.run(PKM, 'run', '--without', 'linear_motor_d3')
    assert done.returncode == 1
    assert "without: no node of this cell is called ['linear_motor_d3']; known: ['machine', " in done.stderr
    assert 'linear motors and laser run in the process of machine' in done.stderr
    assert 'Traceback' not in done.stderr
    done = processes.run(ROS2, 'run', 'pkm_nodes', 'cell', '--ros-args', '-p', 'without:=nobody,machine')
    assert done.returncode == 1
    assert "without: no node of this cell is called ['nobody']" in done.stderr
