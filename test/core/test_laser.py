"""Laser: its clock, resolution and noise, and the end point of the specimen it looks at."""

from dataclasses import replace

import numpy as np
import pytest

from pkm_core.assembly import assemble
from pkm_core.errors import PkmError
from pkm_core.laser import Laser
from pkm_core.machines import load_machine
from pkm_core.plant import Plant
from pkm_core.truth import load_truth

MACHINES = ('four_dof', 'planar', 'xy_stage')


def observed(plant, laser, volts):
    samples = []
    laser.zero(plant.truth)
    for row in volts:
        plant.tick(row)
        sample = laser.observe(plant.truth)
        if sample:
            samples.append(sample)
    return np.array([s.time for s in samples]), np.array([s.displacement for s in samples])


@pytest.mark.parametrize('name', MACHINES)
def test_end_point_of_a_nominal_specimen_is_the_forward_kinematics(name):
    plant = Plant(load_machine(name), 1, 'ideal')
    q = plant.machine.home + np.random.default_rng(1).uniform(-0.015, 0.015, (50, plant.machine.home.size))
    np.testing.assert_allclose(
        plant.truth.assembly.end_point(q, np.zeros((50, 0))), plant.machine.forward(q), rtol=0.0, atol=1e-15 * 100
    )
    np.testing.assert_allclose(plant.truth.pose, plant.machine.forward(plant.machine.home), atol=1e-13)


def test_link_errors_move_the_end_point_as_the_error_matrix_says():
    # E_M at mid travel (4.17), columns l2, l4, l6, l8, k10, k12; phi in rad/mm
    expected = np.array(
        [
            [0.58333333, -0.58333333, 0.2766993, 0.2766993, -1.6080786, 1.6080786],
            [0.2766993, 0.2766993, -0.58333333, 0.58333333, 1.6080786, -1.6080786],
            [-0.04886658, 0.13705866, 0.13705866, -0.04886658, 0.51254124, 0.51254124],
            [0.02372213e3, -0.00845783e3, 0.00845783e3, -0.02372213e3, 0.0, 0.0],
        ]
    )
    plant = Plant(load_machine('four_dof'), 1, 'ideal')
    assembly, q = plant.truth.assembly, plant.machine.home

    def pose(link, error):
        changed = replace(assembly, lengths={**assembly.lengths, link: assembly.lengths[link] + error})
        return changed.end_point(q, np.zeros(0))

    found = np.stack([(pose(link, 1e-7) - pose(link, -1e-7)) / 2e-7 for link in assembly.lengths], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-5)  # eight digits given, rad/m a thousand times larger


def test_specimens_differ_by_seed_and_spread():
    machine = load_machine('four_dof')
    truth, levels = load_truth(machine, 'nominal')
    specimens = [assemble(machine, truth, levels, seed) for seed in range(40)]
    errors = np.array([list(each.lengths.values()) for each in specimens]) - ([0.07] * 4 + [0.1166] * 2)
    assert errors.std() == pytest.approx(10e-6, rel=0.2)  # 240 draws: 5 % of standard error
    assert abs(errors.mean()) < 2e-6
    assert np.std([each.payload for each in specimens]) == pytest.approx(0.02 * 2.3e-3, rel=0.4)
    again = Plant(machine, 3, 'nominal').truth.assembly
    assert again.lengths == specimens[3].lengths
    assert again.payload == specimens[3].payload


def test_samples_come_each_0p8_ms_in_steps_of_0p91_um():
    plant = Plant(load_machine('four_dof'), 4, 'nominal')
    laser = Laser(plant.machine, 4, 'nominal')
    times, displacements = observed(plant, laser, np.tile([0.5, 0.4, -0.5, -0.4], (160, 1)))
    np.testing.assert_allclose(np.diff(times), 0.8e-3, rtol=1e-9)
    assert len(times) == 101
    steps = displacements / np.array([0.91e-6, 0.91e-6, 0.91e-6, 0.91e-6 / 0.05])
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert np.abs(steps).max() > 100


def test_measurement_follows_the_true_end_point():
    plant = Plant(load_machine('planar'), 4, 'ideal')
    laser = Laser(plant.machine, 4, 'ideal')
    datum = plant.truth.pose
    poses = {0.0: datum}
    laser.zero(plant.truth)
    for k in range(160):
        plant.tick([0.5 * np.cos(0.05 * k), 0.3])
        poses[plant.truth.time] = plant.truth.pose
        sample = laser.observe(plant.truth)
        if sample and k % 8 == 7:  # every 4 ms the clocks meet
            assert sample.time == pytest.approx(plant.truth.time)
        if sample:
            times = np.array(list(poses))
            linear = [np.interp(sample.time, times, np.array(list(poses.values()))[:, i]) for i in range(2)]
            # half a step, and what a straight line is off at 5 m/s^2 over 0.5 ms
            assert np.abs(sample.displacement + datum - linear).max() < 0.455e-6 + 0.16e-6


def test_noise_is_its_own_and_repeats_with_the_seed():
    def resting(seed):
        plant = Plant(load_machine('xy_stage'), 4, 'ideal')
        return observed(plant, Laser(plant.machine, seed, 'hard'), np.zeros((1600, 2)))[1]

    first = resting(7)
    np.testing.assert_array_equal(first, resting(7))
    assert not np.array_equal(first, resting(8))
    # 0.5 um of noise rounded to 0.91 um: sqrt(0.25 + 0.91^2 / 12) um
    np.testing.assert_allclose(first.std(axis=0), 0.564e-6, rtol=0.1)


def test_encoder_offsets_are_not_seen_as_motion_but_shift_the_pose():
    machine = load_machine('four_dof')
    plant = Plant(machine, 4, 'nominal')
    offset = plant.truth.assembly.encoder_offset
    assert np.abs(offset).max() > 1e-6
    np.testing.assert_allclose(plant.truth.q, machine.home - offset, atol=1e-15)
    assert np.abs(plant.truth.pose - machine.forward(machine.home))[:3].max() > 1e-6
    _, displacements = observed(plant, Laser(machine, 4, 'nominal'), np.zeros((40, 4)))
    assert np.abs(displacements[:, :3]).max() < 3e-6


def test_belts_bend_under_acceleration_and_the_laser_sees_it():
    machine = load_machine('four_dof')
    plant = Plant(machine, 4, 'elastic')
    resting = plant.truth.belts
    assert np.degrees(np.abs(resting)).max() < 2e-3
    for _ in range(40):
        plant.tick([1.0, 0.9, 1.0, 0.9])
    truth = plant.truth
    bend = np.degrees(truth.belts - resting)
    assert 1e-3 < np.abs(bend).max() < 0.03
    stiff = truth.assembly.end_point(truth.q, np.zeros(0))
    # P and Q move by psi times 10 mm, the end point by half of each
    moved = 5e-3 * np.array([-truth.belts[0], truth.belts[1]])
    np.testing.assert_allclose((truth.pose - stiff)[:2], moved, atol=0.05 * np.abs(moved).max())


def test_laser_after_a_reset_must_be_zeroed():
    plant = Plant(load_machine('planar'), 1, 'ideal')
    laser = Laser(plant.machine, 1, 'ideal')
    for _ in range(4):
        plant.tick([0.0, 0.0])
        laser.observe(plant.truth)
    plant.reset()
    with pytest.raises(PkmError, match='call zero'):
        laser.observe(plant.truth)
    laser.zero(plant.truth)
    plant.tick([0.0, 0.0])
    assert laser.observe(plant.truth).time == 0.0
