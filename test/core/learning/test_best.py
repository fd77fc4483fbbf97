"""The feedforward kept of a learned motion, and the first feedforward of later runs and other motions."""

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import LearningError
from pkm_core.learning import make_law
from pkm_core.learning.best import Best
from pkm_core.learning.initial import first_feedforward
from pkm_core.learning.store import Learned, save
from pkm_core.machines import load_machine
from pkm_core.motion.planning import Motion, Target, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

MACHINE = load_machine('planar')
GAINS = load_control(MACHINE)
NAME = 'planar_80ms'
TRAJECTORY = to_joints(MACHINE, plan(MACHINE, load_motion(NAME)))
OTHER = to_joints(MACHINE, plan(MACHINE, Motion(machine='planar', targets=(Target(by={'d1': 3e-3}),))))


def best_of(law, cycles):
    """Return the `Best` of (joint, rms error, level of the feedforward, iteration)."""
    best, samples = Best(MACHINE, NAME, law, TRAJECTORY), len(TRAJECTORY)
    for joint, error, level, iteration in cycles:
        best.observe(joint, GAINS[joint], np.full(samples, error), np.full(samples, level), iteration)
    return best


def test_feedforward_with_the_lowest_error_of_a_joint_is_kept():
    learned = best_of(
        'inverse', [('d1', 3e-6, 0.0, 0), ('d3', 1e-6, 7.0, 0), ('d1', 1e-6, 1.0, 1), ('d1', 2e-6, 2.0, 2)]
    ).learned()
    assert learned.feedforward.shape == TRAJECTORY.position.shape
    assert learned.feedforward[0].tolist() == [1.0, 7.0]
    assert learned.parameters == {}


def test_restart_of_learning_discards_the_previous_best():
    cycles = [('d3', 1e-6, 7.0, 0), ('d1', 1e-6, 1.0, 0), ('d1', 5e-6, 2.0, 0), ('d1', 6e-6, 3.0, 1)]
    assert best_of('inverse', cycles).learned().feedforward[0].tolist() == [2.0, 7.0]


def test_joint_without_a_cycle_is_named():
    with pytest.raises(LearningError, match=r"'planar_80ms', law 'inverse': no cycle of \['d1'\] yet"):
        best_of('inverse', [('d3', 1e-6, 7.0, 0)]).learned()


@pytest.fixture
def path(tmp_path):
    """Return a file of three cycles of the basis law on the machine."""
    law, best = make_law('basis', MACHINE, GAINS), Best(MACHINE, NAME, 'basis', TRAJECTORY)
    records = run_cycles(MACHINE, TRAJECTORY, GAINS, law, 3, seed=1)
    for cycle in range(3):
        for column, joint in enumerate(MACHINE.joints):
            rows = records.error[cycle, :, column], records.feedforward[cycle, :, column]
            best.observe(joint, GAINS[joint], *rows, cycle)
    save(tmp_path / 'learned.npz', best.learned())
    return tmp_path / 'learned.npz'


def begin(path, law, trajectory=TRAJECTORY, motion=NAME, gains=GAINS):
    return first_feedforward(path, MACHINE, motion, law, gains, trajectory)


@pytest.mark.parametrize('law', ['none', 'inverse', 'basis'])
def test_same_motion_starts_with_its_feedforward_under_any_law(path, law):
    start = begin(path, law)
    first = run_cycles(MACHINE, TRAJECTORY, GAINS, None, 1, seed=2, start=start).metric('max_dynamic_error').max()
    assert first < 0.5 * run_cycles(MACHINE, TRAJECTORY, GAINS, None, 1, seed=2).metric('max_dynamic_error').max()


def test_basis_parameters_start_other_motions(path):
    start = begin(path, 'basis', OTHER, 'other')
    errors = [
        run_cycles(MACHINE, OTHER, GAINS, None, 1, seed=2, start=each).metric('max_dynamic_error').max()
        for each in (start, None)
    ]
    assert errors[0] < 0.7 * errors[1]


def test_other_motions_other_gains_and_other_lengths_are_refused(path, tmp_path):
    with pytest.raises(LearningError, match="was learned for another motion 'planar_80ms', here 'other'; reference"):
        begin(path, 'inverse', OTHER, 'other')
    softer = {joint: axis_gains.model_copy(update={'kp': 0.9 * axis_gains.kp}) for joint, axis_gains in GAINS.items()}
    with pytest.raises(LearningError, match='was learned for another config'):
        begin(path, 'basis', OTHER, 'other', softer)
    learned = best_of('inverse', [('d1', 1e-6, 0.0, 0), ('d3', 1e-6, 0.0, 0)]).learned()
    save(tmp_path / 'short.npz', Learned(learned.origin, learned.feedforward[:9], {}))
    with pytest.raises(LearningError, match=r'short.npz: feedforward has shape \(9, 2\); expected \(720, 2\)'):
        begin(tmp_path / 'short.npz', 'none')
