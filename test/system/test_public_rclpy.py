"""A cell that uses rclpy's public API only, as with versions of ROS that the fast path was not made for."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.control.robust import load_control
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles
from pkm_nodes.runtime.fast_path import SWITCH

DOMAIN = 116
PKM = Path(sys.prefix) / 'bin' / 'pkm'


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'arrangement', 'cycles'), [('four_dof', 'composed', 2), ('planar', 'processes', 1)])
def test_public_api_gives_the_same_bits_and_loses_nothing(processes, name, arrangement, cycles):
    processes.environment[SWITCH] = '1'
    options = ('--machine', name, '--law', 'fourier_pid', '--seed', 7, '--cycles', cycles, '--arrangement', arrangement)
    done = processes.run(PKM, 'run', *options, '--out', 'run', '--json', 'results.json')
    assert done.returncode == 0, done.stdout + done.stderr
    results = json.loads((processes.folder / 'results.json').read_text())
    counted = {topic: count for topic, count in results['messages'].items() if count['expected'] is not None}
    assert len(counted) >= 10
    assert {topic: count for topic, count in counted.items() if count['recorded'] != count['expected']} == {}

    machine = load_machine(name)
    trajectory = to_joints(machine, plan(machine, load_motion(default_motion(machine))))
    gains = load_control(machine)
    simulated = run_cycles(machine, trajectory, gains, make_law('fourier_pid', machine, gains), cycles, seed=7)
    records = [read_cycle(path) for path in sorted((processes.folder / 'run' / 'bags').iterdir())]
    assert len(records) == cycles
    for number, record in enumerate(records):
        for quantity in ('counts', 'voltage', 'error'):
            assert np.array_equal(getattr(record, quantity), getattr(simulated, quantity)[number])
    for log in (processes.folder / 'run' / 'log').iterdir():
        assert log.read_text().count(f'servo tick: {SWITCH} is 1') == 1, log.name
