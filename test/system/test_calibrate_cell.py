"""`pkm calibrate-cell`: lengths of the simulated machine by laser, in the graph of nodes."""

import json
import signal
import sys
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import read_metadata
from pkm_core.design.pose_plan import spread_poses
from pkm_core.machines import load_machine
from pkm_core.machines.geometry import load_geometry
from pkm_core.simulation.true_rests import true_rests

DOMAIN = 93
PKM = Path(sys.prefix) / 'bin' / 'pkm'
SEED = 5
FEW = ('--poses', 8, '--verification', 4, '--wait', 40, '--averaging', 60)
COMMAND = (PKM, 'calibrate-cell', '--machine', 'planar', '--seed', SEED, '--out')


@pytest.fixture(scope='module')
def calibrated(module_processes):
    """Return the folder and the figures of a short calibration of the composed cell."""
    out = module_processes.folder / 'out'
    done = module_processes.run(*COMMAND, out, *FEW, '--json', out / 'found.json')
    assert done.returncode == 0, done.stdout + done.stderr
    return out, json.loads((out / 'found.json').read_text())


def errors(machine, poses):
    """Return the rms (m,) [m] of where the simulated machine truly rests against the commanded poses."""
    off = true_rests(machine, poses, SEED) - poses
    return np.sqrt(np.mean((off - off.mean(axis=0)) ** 2, axis=0))


def test_calibrated_cell_rests_where_it_is_sent(calibrated):
    """By the truth of the plant, at poses that neither fit nor verification used; the figures of the command agree."""
    out, figures = calibrated
    drawn, machine = load_machine('planar'), load_machine(out / 'calibrated' / 'planar.yaml')
    poses = spread_poses(drawn, 12, seed=77)
    before, after = errors(drawn, poses), errors(machine, poses)
    assert (before > 1e-6).any()
    assert (after < 0.4e-6).all(), 'eight poses; twenty reach 0.3 um'
    assert figures['accepted']
    assert 0.3 < figures['misfit'] < 1.5
    assert max(figures['errors']['calibrated, rms'].values()) < 0.5e-6 < max(figures['errors']['before, rms'].values())


def test_bags_name_the_geometry_of_their_cycle(calibrated):
    out, figures = calibrated
    file = out / 'calibrated' / 'planar.yaml'
    first, last = (read_metadata(bag)['custom_data'] for bag in figures['bags'])
    assert (first['machine'], first['geometry']) == ('planar', load_geometry('planar').digest)
    assert (last['machine'], last['geometry']) == (str(file), load_geometry(file).digest)
    assert last['geometry'] == figures['geometry']
    assert first['config_hash'] != last['config_hash']


def test_interrupted_calibration_leaves_a_readable_bag(processes):
    out = processes.folder / 'out'
    process = processes.start(*COMMAND, out, '--poses', 60)
    deadline = monotonic() + 60.0
    while not list((out / 'bags').glob('*/*.mcap')):
        assert process.poll() is None, (processes.folder / 'log').read_text()
        assert monotonic() < deadline
        sleep(0.1)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=30.0) == 130
    assert 'Traceback' not in (processes.folder / 'log').read_text() + (out / 'log' / 'cell.log').read_text()
    [bag] = (out / 'bags').iterdir()
    record = read_cycle(bag)
    assert 0 < len(record.ticks) < record.samples
    assert not (out / 'calibrated').exists()


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (('--poses', 3), 'calibration: 3 poses given; allowed 4 to 200 for planar'),
        (('--averaging', 'nan'), 'averaging is nan s; allowed above 0 to 5 s'),
        (('--machine', 'xy_stage'), 'xy_stage: a xy_stage has no links'),
    ],
)
def test_infeasible_request_starts_no_process(processes, options, reason):
    out = processes.folder / 'out'
    done = processes.run(*COMMAND, out, *options)
    assert done.returncode == 1
    assert done.stderr.startswith('pkm: ')
    assert reason in done.stderr
    assert not out.exists()
