"""The basis law: its forces, recovery of parameters, and their validity on other motions."""

from functools import cache

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import LearningError
from pkm_core.experiments.transfer import transfer
from pkm_core.learning import make_law
from pkm_core.learning.regressors import forces, slip
from pkm_core.learning.training import training_motion
from pkm_core.machines import load_machine
from pkm_core.motion.planning import Motion, Target, plan
from pkm_core.motion.trajectory import to_joints

TS = 0.5e-3
MACHINES = ('four_dof', 'planar')


@cache
def law(name):
    machine = load_machine(name)
    return make_law('basis', machine, load_control(machine))


def joints(name, motion):
    machine = load_machine(name)
    return to_joints(machine, plan(machine, motion))


@cache
def training(name):
    return joints(name, training_motion(load_machine(name)))


def test_training_motion_moves_pairs_alike_and_oppositely():
    for name in MACHINES:
        acceleration = training(name).acceleration
        correlation = acceleration.T @ acceleration
        off = correlation - np.diag(np.diagonal(correlation))
        assert np.abs(off).max() < 1e-9 * np.diagonal(correlation).min()


def test_training_motion_visits_both_sides_of_home():
    machine = load_machine('four_dof')
    away = training('four_dof').position - machine.home
    np.testing.assert_allclose([away.min(axis=0), away.max(axis=0)], [[-5e-3] * 4, [5e-3] * 4], atol=1e-12)


def test_slip_reverses_within_its_length_and_holds_at_rest():
    position = np.concatenate([np.linspace(0, 1e-3, 400), np.full(50, 1e-3), np.linspace(1e-3, 0, 400)])
    rested = slip(position, 20e-6, rested=True)
    assert rested[0] == 0.0
    travelled = position[8]
    assert rested[8] == pytest.approx(1 - np.exp(-travelled / 20e-6))
    assert rested[399] == pytest.approx(1.0)
    np.testing.assert_array_equal(rested[400:450], rested[399])
    assert rested[-1] == pytest.approx(-1.0)
    # in repetition the cycle begins with the state at the end of the previous one
    assert slip(position, 20e-6, rested=False)[0] == pytest.approx(rested[-1])


def test_design_forces_are_those_of_the_inverse_dynamics():
    machine, trajectory = load_machine('four_dof'), training('four_dof')
    q, qd, qdd, _ = trajectory.derivatives()
    for column, joint in enumerate(machine.joints):
        shapes = forces(machine, law('four_dof').models[joint], trajectory, column, (), rested=False)
        own = machine.mass_matrix(machine.home)[column, column] * qdd[:, column] + machine.gravity(machine.home)[column]
        partners = sum(shapes[f'acceleration_{other}'] for other in machine.joints if other != joint)
        total = (partners + shapes['configuration']) * machine.thrust_per_volt + own
        np.testing.assert_allclose(total, machine.inverse_dynamics(q, qd, qdd)[:, column], atol=1e-9)


@pytest.mark.parametrize('name', MACHINES)
def test_parameters_of_a_feedforward_are_recovered(name):
    bound = law(name).with_reference(training(name))
    rng = np.random.default_rng(4)
    for joint in law(name).gains:
        names = bound.parameters(joint, np.zeros(len(training(name))))
        wanted = {key: float(rng.uniform(-0.5, 0.5)) for key in names}
        found = bound.parameters(joint, bound.feedforward(joint, wanted))
        assert found == pytest.approx(wanted, abs=1e-6)


def test_explainable_error_is_removed_in_one_update_on_the_model():
    name, joint = 'planar', 'd3'
    bound, samples = law(name).with_reference(training(name)), len(training(name))
    wanted = dict.fromkeys(bound.parameters(joint, np.zeros(samples)), 0.02)
    frequency = np.fft.rfftfreq(samples, TS)
    path = np.zeros(frequency.shape, dtype=complex)
    path[1:] = bound.path(joint, frequency[1:])
    feedforward = bound.feedforward(joint, wanted)
    error = np.fft.irfft(path * np.fft.rfft(feedforward), samples)
    # the ends of the cycle are not exactly at rest: the friction has a mean, which closing tilts slightly
    np.testing.assert_allclose(bound.update(joint, error, np.zeros(samples), 0, TS), feedforward, atol=2e-4)


def test_forces_a_motion_does_not_excite_are_left_out():
    single = joints('planar', Motion(machine='planar', targets=(Target(by={'d1': 3e-3}),)))
    bound = law('planar').with_reference(single)
    wanted = dict.fromkeys(bound.parameters('d1', np.zeros(len(single))), 1.0)
    feedforward = bound.feedforward('d1', wanted)
    found = bound.parameters('d1', feedforward)
    assert found['acceleration_d3'] == 0.0
    assert found['acceleration'] == pytest.approx(1.0, abs=1e-3)


def test_basis_law_without_reference_is_refused():
    with pytest.raises(LearningError, match='d1: the basis law needs the reference; none given by with_reference'):
        law('planar').update('d1', np.zeros(600), np.zeros(600), 0, TS)


def test_reference_of_another_length_or_machine_is_refused():
    bound = law('planar').with_reference(training('planar'))
    with pytest.raises(LearningError, match='d1: 600 samples; the reference has'):
        bound.update('d1', np.zeros(600), np.zeros(600), 0, TS)
    with pytest.raises(LearningError, match=r"reference of \('d1', 'd3', 'd5', 'd7'\)"):
        law('planar').with_reference(training('four_dof'))


def test_parameters_of_another_joint_or_not_finite_are_refused():
    bound = law('planar').with_reference(training('planar'))
    parameters = bound.parameters('d1', np.zeros(len(training('planar'))))
    with pytest.raises(LearningError, match='learning d1: the next feedforward is not finite'):
        bound.feedforward('d1', parameters | {'jerk': np.nan})
    with pytest.raises(LearningError, match=r'learning d3: parameters .* expected'):
        bound.feedforward('d3', parameters)


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'limit'), [('four_dof', 4.0), ('planar', 8.0)])
def test_first_cycle_of_unlearned_moves_is_within_micrometres(name, limit):
    for seed in (1, 2, 3, 4, 5):
        error, settling = transfer(name, seed)
        assert len(error) == 4
        assert 1e6 * error.max() <= limit
        assert settling.max() == 0.0
