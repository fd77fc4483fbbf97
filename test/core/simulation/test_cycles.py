"""The closed loop without ROS: repeatability, error of robust control, and error after learning."""

import shutil
from functools import cache

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.metrics import axis_metrics
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

MOTIONS = {'four_dof': 'four_dof_70ms', 'planar': 'planar_80ms'}
UM = 1e6


@cache
def setup(name):
    machine = load_machine(name)
    return machine, to_joints(machine, plan(machine, load_motion(MOTIONS[name]))), load_control(machine)


@cache
def run(name, law, cycles, seed=1, environment='nominal'):
    machine, trajectory, gains = setup(name)
    law = law and make_law(law, machine, gains)
    return run_cycles(machine, trajectory, gains, law, cycles, seed, environment)


def dynamic_error(records):
    """Return the max dynamic error [um] as (cycles, n)."""
    return UM * records.metric('max_dynamic_error')


def test_records_have_the_signals_of_the_loop():
    machine, trajectory, _ = setup('four_dof')
    records = run('four_dof', 'fourier', 2)
    assert records.joints == machine.joints
    assert records.counts.dtype == np.int64
    assert records.error.shape == records.counts.shape == records.voltage.shape == records.feedforward.shape
    np.testing.assert_array_equal(records.error, trajectory.position - records.counts * machine.encoder_resolution)
    assert np.abs(records.voltage).max() <= machine.voltage_limit
    expected = axis_metrics(records.error[1, :, 2], trajectory.move_starts, trajectory.move_ends, machine.sample_time)
    assert records.metrics[1][2] == expected


def test_same_seed_gives_the_same_bits_for_any_number_of_cycles():
    machine, trajectory, gains = setup('four_dof')
    again = run_cycles(machine, trajectory, gains, make_law('fourier', machine, gains), 1, 1)
    for name in ('error', 'counts', 'voltage', 'feedforward'):
        np.testing.assert_array_equal(getattr(again, name)[0], getattr(run('four_dof', 'fourier', 2), name)[0])


def test_another_seed_gives_other_noise():
    assert (run('four_dof', None, 2).counts != run('four_dof', None, 2, seed=2).counts).any()


def test_feedforward_is_the_law_applied_to_the_previous_cycle():
    machine, _, gains = setup('four_dof')
    records, law = run('four_dof', 'fourier_pid', 8), make_law('fourier_pid', machine, gains)
    assert not records.feedforward[0].any()
    for axis, joint in enumerate(machine.joints):
        expected = law.update(joint, records.error[4, :, axis], records.feedforward[4, :, axis], 4, machine.sample_time)
        np.testing.assert_array_equal(records.feedforward[5, :, axis], expected)


@pytest.mark.parametrize('name', MOTIONS)
def test_robust_control_alone_leaves_tens_of_micrometres(name):
    records = run(name, None, 2)
    error = dynamic_error(records)
    assert error.max() < 35.0  # 20 to 28 um measured; the thesis's robust controller left 9 to 47 um
    assert error.min() > 5.0
    assert np.nanmax(records.metric('settling_time_5um')) < 40e-3
    assert np.abs(records.metric('steady_state_error')).max() < 1e-6


@pytest.mark.parametrize('name', MOTIONS)
def test_learning_through_the_pid_reaches_2_um_in_six_updates(name):
    records = run(name, 'fourier_pid', 8)
    assert dynamic_error(records)[6:].max() <= 2.0  # 0.5 to 1.5 um measured
    assert records.metric('settling_time_5um')[4:].max() == 0.0


def test_first_updates_of_the_thesis_law_halve_the_error():
    error = dynamic_error(run('four_dof', 'fourier', 4))
    assert (error[3] < 0.6 * error[0]).all()


def test_cycle_boundary_does_not_disturb_the_rest():
    _, trajectory, _ = setup('four_dof')
    records = run('four_dof', 'fourier_pid', 8)
    before_first_move = records.error[1:, : trajectory.move_starts[0]]
    assert (
        UM * np.abs(before_first_move).max() < 1.6
    )  # 1.0 measured; 2.4 when the integrator did not take up the step of the feedforward


def test_fault_of_the_machine_ends_the_run_with_cycle_and_sample():
    machine, trajectory, gains = setup('four_dof')
    # with kp < 0 the axes run away
    wrong = {joint: axis_gains.model_copy(update={'kp': -axis_gains.kp}) for joint, axis_gains in gains.items()}
    with pytest.raises(PkmError, match=r'cycle 1, sample \d+: '):
        run_cycles(machine, trajectory, wrong, None, 1, 1)


@pytest.mark.slow
@pytest.mark.parametrize('name', MOTIONS)
@pytest.mark.parametrize(('law', 'from_cycle', 'limit'), [('fourier', 12, 4.5), ('fourier_pid', 8, 2.5)])
def test_law_stays_converged_for_forty_cycles(name, law, from_cycle, limit):
    # divergence is slow: such a law seems converged at cycle 4 and reaches 100 um at cycle 24
    for seed in (1, 2):
        assert dynamic_error(run(name, law, 40, seed))[from_cycle:].max() < limit


@pytest.mark.slow
@pytest.mark.parametrize('name', MOTIONS)
def test_learning_helps_in_the_hard_environment(name):
    error = dynamic_error(run(name, 'fourier_pid', 20, environment='hard'))
    assert error[8:].mean() < 0.25 * error[0].mean()
    assert error[8:].max() < 12.0


def test_first_cycle_under_a_given_feedforward_is_not_learned():
    """The friction of power-up would be learned at gain 1: 9.0, 9.2, 1.3 um instead of 9.0, 1.0, 0.9."""
    machine, trajectory, gains = setup('four_dof')
    learned = run('four_dof', 'inverse', 8).feedforward[-1]
    records = run_cycles(machine, trajectory, gains, make_law('inverse', machine, gains), 3, 101, start=learned)
    np.testing.assert_array_equal(records.feedforward[0], learned)
    np.testing.assert_array_equal(records.feedforward[1], learned)
    assert (records.feedforward[2] != learned).any()
    error = dynamic_error(records).max(axis=1)
    assert error[0] > 5.0
    assert error[1:].max() < 2.5


def test_first_cycle_with_identified_forces_is_not_learned(tmp_path):
    machine, trajectory, gains = setup('planar')
    shutil.copytree(machine.configuration.folder, tmp_path / 'config')
    file, forces = tmp_path / 'config/model/planar.yaml', 'forces: {coulomb: 45 mV, slip: 10 um, coupling: 1}'
    head, tail = file.read_text().split('  d3:\n')
    file.write_text(f'{head}    {forces}\n  d3:\n{tail}')
    known = machine.with_configuration(Configuration(tmp_path / 'config'))
    records = run_cycles(known, trajectory, gains, make_law('inverse', known, gains), 3, 1)
    assert not records.feedforward[:2, :, 0].any()  # d1
    assert records.feedforward[2, :, 0].any()
    assert records.feedforward[1, :, 1].any()  # d3 has no forces in its model
