"""`pkm commission` on the real graph: from an unknown machine to a learned motion, or back to its old gains."""

import json
import sys
from pathlib import Path

import pytest

from pkm_core.config import Configuration
from pkm_core.control.robust import load_control
from pkm_core.design.pose_plan import spread_poses
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles
from pkm_core.simulation.true_rests import true_rests

DOMAIN = 92
PKM = Path(sys.prefix) / 'bin' / 'pkm'


@pytest.fixture(scope='module')
def tuning(tmp_path_factory):
    """Return a file with the targets of config/tuning/robust.yaml for a search of a few seconds."""
    text = (Configuration.of_environment().folder / 'tuning' / 'robust.yaml').read_text()
    for whole, part in (
        *(('population: 100', 'population: 40'), ('generations: 160', 'generations: 20')),
        ('restarts: 2', 'restarts: 1'),
    ):
        assert whole in text
        text = text.replace(whole, part)
    path = tmp_path_factory.mktemp('tuning') / 'quick.yaml'
    path.write_text(text)
    return path


def commission(processes, tuning, *options):
    out = processes.folder / 'out'
    command = (PKM, 'commission', '--machine', 'planar', '--specimen', 3, '--tuning', tuning, '--out', out)
    return processes.run(*command, *options, timeout=900), out  # a minute on an idle machine


@pytest.mark.timeout(900)  # it starts a cell twice and ten processes in all
def test_unknown_machine_is_commissioned_on_the_graph(processes, tuning, monkeypatch):
    """On the real graph, from the gains as found to the learned motion."""
    done, out = commission(processes, tuning, '--cycles', 5)
    assert done.returncode == 0, done.stdout + done.stderr
    results = json.loads((out / 'results.json').read_text())
    assert results['accepted'], results['reasons']
    errors = results['max_dynamic_error_um']
    found, tuned = (max(errors[name][0].values()) for name in ('as_found', 'tuned'))
    assert max(errors['learned'][-1].values()) < 0.3 * tuned < tuned < found
    assert 'recommended' in done.stdout
    assert 'as found' in done.stdout
    assert '<svg' not in (out / 'report.html').read_text()  # figures are separate images
    # one cell from beginning to end: the motion as found, every experiment, the acceptance move, poses of calibration
    # and verification, what was learned
    assert len(list((out / 'as_found' / 'bags').iterdir())) == 1 + 2 * 4 + 1 + 2 + 5
    calibration = results['calibration']
    assert calibration['taken_up'], results['not_calibrated']
    assert max(calibration['end_point']['after'].values()) < 0.5e-6 < max(calibration['end_point']['before'].values())
    assert 'End point at rest by laser' in (out / 'report.html').read_text()
    assert not (out / 'tuned').exists()

    # what is left behind is the machine under the gains that have passed; from power-up its noise is another
    monkeypatch.setenv('PKM_CONFIG', str(out / 'config'))
    machine = load_machine('planar')
    assert str(machine.specimen) == 'planar, seed 1, environment nominal'
    poses = spread_poses(machine, 6, 5)
    off = true_rests(machine, poses, seed=1) - poses
    assert (abs(off - off.mean(axis=0)) < 0.6e-6).all()  # the tool is where it is sent
    trajectory = to_joints(machine, plan(machine, load_motion(default_motion(machine))))
    records = run_cycles(machine, trajectory, load_control(machine), None, cycles=1, seed=1)
    again = 1e6 * records.metric('max_dynamic_error')[0]
    for error, joint in zip(again, machine.joints, strict=True):
        assert error == pytest.approx(errors['tuned'][0][joint], rel=0.5, abs=5)  # far from that of the gains as found


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (('--law', 'magic'), "learning law 'magic' is unknown"),
        (('--motion', 'nowhere'), "motions: 'nowhere' is unknown"),
        (('--tuning', 'loud'), "tuning: 'loud' is unknown"),
        (('--environment', 'storm'), "environment 'storm' is unknown"),
    ],
)
def test_infeasible_commissioning_is_refused_before_any_motion(processes, tuning, options, reason):
    done, out = commission(processes, tuning, *options, '--arrangement', 'simulation')
    assert done.returncode == 1
    assert reason in done.stderr
    assert not (out / 'report.html').exists()
