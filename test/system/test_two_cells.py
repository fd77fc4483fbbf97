"""Two cells in one graph at the same time: each gives the results of a single cell."""

import json
import sys
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest
import rclpy

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import read_topics
from pkm_core.control.robust import load_control
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.machines.description import ROOT
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

DOMAIN = 121
PKM = Path(sys.prefix) / 'bin' / 'pkm'
# namespace: machine, arrangement, seed
CELLS = {'left': ('four_dof', 'composed', 7), 'hall_2/right': ('planar', 'processes', 8)}
TIMEOUT = 300.0  # [s, wall] both cells take seconds; the rest is reserve


@contextmanager
def listener():
    """Return a node of the test in the domain of the cells."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        context = rclpy.Context()
        context.init(domain_id=DOMAIN)
        yield rclpy.create_node('test_two_cells', context=context)
        context.shutdown()


@pytest.fixture(scope='module')
def runs(tmp_path_factory, module_processes):
    """Return {namespace: output folder} of two cells that ran at the same time, and the topics of their graph."""
    folders = {name: tmp_path_factory.mktemp('cell') / 'run' for name in CELLS}
    started = {
        name: module_processes.start(
            *(PKM, 'run', '--namespace', name, '--machine', machine, '--arrangement', arrangement, '--seed', seed),
            *('--cycles', 3, '--law', 'fourier_pid', '--out', folders[name]),
            log=f'{machine}.log',
        )
        for name, (machine, arrangement, seed) in CELLS.items()
    }
    end, topics = monotonic() + TIMEOUT, set()
    with listener() as node:
        while any(process.poll() is None for process in started.values()) and monotonic() < end:
            topics |= {name for name, _ in node.get_topic_names_and_types()}
            sleep(0.2)
    for name, process in started.items():
        machine_name = CELLS[name][0]
        assert process.poll() == 0, (module_processes.folder / f'{machine_name}.log').read_text()
    return folders, topics


@pytest.mark.parametrize('name', CELLS)
def test_each_cell_gives_the_bits_of_a_single_cell(runs, name):
    machine_name, _, seed = CELLS[name]
    machine = load_machine(machine_name)
    trajectory = to_joints(machine, plan(machine, load_motion(default_motion(machine))))
    gains = load_control(machine)
    alone = run_cycles(machine, trajectory, gains, make_law('fourier_pid', machine, gains), cycles=3, seed=seed)
    records = [read_cycle(path) for path in sorted((runs[0][name] / 'bags').iterdir())]
    assert len(records) == 3
    for number, record in enumerate(records):
        assert np.array_equal(record.counts, alone.counts[number])
        assert np.array_equal(record.voltage, alone.voltage[number])


@pytest.mark.parametrize('name', CELLS)
def test_frames_of_each_cell_have_its_namespace(runs, name):
    (path, *_) = sorted((runs[0][name] / 'bags').iterdir())
    poses = read_topics(path, [f'/{name}/pose'])[f'/{name}/pose']
    assert {pose.header.frame_id for pose in poses} == {f'{name}/{ROOT}'}


@pytest.mark.parametrize('name', CELLS)
def test_bags_hold_all_topics_of_their_own_cell_only(runs, name):
    for path in (runs[0][name] / 'bags').iterdir():
        recorded = read_cycle(path).recorded
        foreign = {topic for topic in recorded if not topic.startswith(f'/{name}/')}
        assert foreign <= {'/diagnostics'}  # all nodes of a graph share it, and a bag has its own cell's of it
        for message in read_topics(path, ['/diagnostics'])['/diagnostics']:
            assert all(status.name.startswith(f'/{name}/') for status in message.status)
    results = json.loads((runs[0][name] / 'results.json').read_text())
    assert all(m['recorded'] >= (m['expected'] or 0) for m in results['messages'].values())


def test_each_cell_has_its_own_clock(runs):
    topics = runs[1]
    assert {f'/{name}/clock' for name in CELLS} <= topics
    assert '/clock' not in topics
    assert not [topic for topic in topics if topic.startswith('/pkm/')]


def test_invalid_namespace_is_refused(module_processes):
    done = module_processes.run(PKM, 'run', '--namespace', '2nd cell')
    assert done.returncode == 1
    assert done.stderr.startswith("pkm: namespace: '2nd cell' given; expected names of letters")
