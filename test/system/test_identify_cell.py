"""`pkm identify-cell`: axes identified on the real graph, with the bits of the simulation without ROS."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.identification.bag_data import read_cell_bag
from pkm_core.identification.excitation import experiments
from pkm_core.identification.identify import identify_joint
from pkm_core.machines import load_machine
from pkm_core.simulation.experiment import SimulatedCell

DOMAIN = 91
PKM = Path(sys.prefix) / 'bin' / 'pkm'


@pytest.fixture(scope='module')
def simulated():
    """Return the records of planar d3's experiments without ROS."""
    machine = load_machine('planar')
    models, gains = load_model(machine), load_control(machine)
    cell = SimulatedCell(machine, gains, 5)
    return [cell.run(each) for each in experiments(machine, 'd3', models, gains)]


@pytest.mark.parametrize('arrangement', ['composed', 'processes'])
def test_graph_gives_records_and_model_of_the_simulation(processes, simulated, arrangement):
    """Records bit for bit."""
    machine, out = load_machine('planar'), processes.folder / 'out'
    models, gains = load_model(machine), load_control(machine)
    done = processes.run(
        *(PKM, 'identify-cell', '--machine', 'planar', '--joint', 'd3', '--seed', 5, '--arrangement', arrangement),
        *('--out', out, '--json', out / 'found.json'),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads((out / 'found.json').read_text())
    assert len(figures['bags']) == len(simulated) == 4
    for bag, record in zip(figures['bags'], simulated, strict=True):
        recorded, warnings = read_cell_bag(machine, bag)
        assert not warnings
        assert np.array_equal(recorded.counts, record.counts)
        assert np.array_equal(recorded.voltage, record.voltage)
    expected = identify_joint(machine, 'd3', simulated, models, gains, band=(80.0, 500.0))
    assert figures['axes']['d3']['gain'] == expected.low.gain
    assert figures['axes']['d3']['modes'] == expected.high.modes.tolist()
    assert load_model(machine, figures['model_file'])['d1'] == models['d1']  # was not asked for
    assert list(Path(figures['model_file']).parent.glob('*response_d3.png'))


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (('--band', '80', '1100'), 'd1: sweep from 80 to 1100 Hz; expected 0 < from < to < 1000 Hz'),
        (('--joint', 'd9'), "joint 'd9' is unknown; planar has"),
        (('--kind', 'all'), "kind 'all'; known"),
    ],
)
def test_infeasible_request_starts_no_process(processes, options, reason):
    out = processes.folder / 'out'
    done = processes.run(PKM, 'identify-cell', '--machine', 'planar', '--out', out, *options)
    assert done.returncode == 1
    assert done.stderr.startswith('pkm: ')
    assert reason in done.stderr
    assert not out.exists()
