"""Laser: its clock, resolution and noise, and the end point of the measured specimen."""

from dataclasses import replace

import numpy as np
import pytest

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.laser_clock import sample_numbers
from pkm_core.plant.laser import Laser
from pkm_core.plant.plant import Plant
from pkm_core.plant.specimen import assemble
from pkm_core.plant.truth import load_truth

MACHINES = ('four_dof', 'planar', 'xy_stage')


def observed(plant, laser, volts, *, tick=0, read_every=20):
    """Return (time, displacement) measured by the laser from `tick` on while `volts` drive the plant."""
    laser.zero(tick, plant.truth)
    readings = []
    for count, row in enumerate(volts, start=1):
        plant.tick(row)
        laser.observe(tick + count, plant.truth)
        if count % read_every == 0:
            readings.append(laser.read())
    readings.append(laser.read())
    return tuple(np.concatenate(parts) for parts in zip(*readings, strict=True))


@pytest.mark.parametrize('name', MACHINES)
def test_end_point_of_nominal_specimen_is_forward_kinematics(name):
    plant = Plant(load_machine(name), 1, 'ideal')
    q = plant.machine.home + np.random.default_rng(1).uniform(-0.015, 0.015, (50, plant.machine.home.size))
    np.testing.assert_allclose(
        plant.truth.assembly.end_point(q, np.zeros((50, 0))), plant.machine.forward(q), rtol=0.0, atol=1e-15 * 100
    )
    np.testing.assert_allclose(plant.truth.pose, plant.machine.forward(plant.machine.home), atol=1e-13)


def test_link_errors_move_the_end_point_as_in_the_error_matrix():
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
    assert len(times) == 100  # of 0 to 79.2 ms; that of 80 ms is due at the last tick and not yet reported
    steps = displacements / np.array([0.91e-6, 0.91e-6, 0.91e-6, 0.91e-6 / 0.05])
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert np.abs(steps).max() > 100


def test_measurement_equals_the_true_end_point_within_a_step():
    plant = Plant(load_machine('planar'), 4, 'ideal')
    laser, twin = Laser(plant.machine, 4, 'ideal'), Plant(plant.machine, 4, 'ideal')
    k = np.arange(160)
    volts = np.stack([0.5 * np.cos(0.05 * k), np.full(160, 0.3)], axis=1)
    times, displacements = observed(plant, laser, volts)
    poses = [twin.truth.pose]
    for row in volts:
        twin.tick(row)
        poses.append(twin.truth.pose)
    poses = np.array(poses) - poses[0]
    linear = np.stack([np.interp(times, 0.5e-3 * np.arange(161), column) for column in poses.T], axis=1)
    assert np.abs(displacements).max() > 1e-3
    # half a step, and the error of linear interpolation at 5 m/s^2 over 0.5 ms
    assert np.abs(displacements - linear).max() < 0.455e-6 + 0.16e-6
    # the clocks coincide every 4 ms: no interpolation there
    assert np.abs(displacements[::5] - poses[:160:8]).max() < 0.456e-6


@pytest.mark.parametrize('tick', [0, 7, 4001])
def test_samples_of_a_range_of_ticks_are_those_due_in_it(tick):
    machine = load_machine('xy_stage')
    times, _ = observed(Plant(machine, 1, 'ideal'), Laser(machine, 1, 'ideal'), np.zeros((33, 2)), tick=tick)
    due = 0.8e-3 * np.arange(4000)
    np.testing.assert_allclose(times, due[(due > 0.5e-3 * tick - 1e-9) & (due < 0.5e-3 * (tick + 33) - 1e-9)])
    assert len(sample_numbers(machine, tick, tick + 33)) == len(times)


def test_samples_do_not_depend_on_how_often_they_are_read():
    machine, volts = load_machine('four_dof'), np.tile([0.5, 0.4, -0.5, -0.4], (90, 1))
    readings = [observed(Plant(machine, 4), Laser(machine, 4), volts, read_every=every) for every in (1, 20, 90)]
    for time, displacement in readings[1:]:
        np.testing.assert_array_equal(time, readings[0][0])
        np.testing.assert_array_equal(displacement, readings[0][1])


def test_noise_is_independent_and_repeats_with_the_seed():
    def resting(seed):
        plant = Plant(load_machine('xy_stage'), 4, 'ideal')
        return observed(plant, Laser(plant.machine, seed, 'hard'), np.zeros((1600, 2)))[1]

    first = resting(7)
    np.testing.assert_array_equal(first, resting(7))
    assert not np.array_equal(first, resting(8))
    # 0.5 um of noise rounded to 0.91 um: sqrt(0.25 + 0.91^2 / 12) um
    np.testing.assert_allclose(first.std(axis=0), 0.564e-6, rtol=0.1)


def test_encoder_offsets_shift_the_pose_and_are_not_motion():
    machine = load_machine('four_dof')
    plant = Plant(machine, 4, 'nominal')
    offset = plant.truth.assembly.encoder_offset
    assert np.abs(offset).max() > 1e-6
    np.testing.assert_allclose(plant.truth.q, machine.home - offset, atol=1e-15)
    assert np.abs(plant.truth.pose - machine.forward(machine.home))[:3].max() > 1e-6
    _, displacements = observed(plant, Laser(machine, 4, 'nominal'), np.zeros((40, 4)))
    assert np.abs(displacements[:, :3]).max() < 3e-6


def test_laser_measures_the_belt_deflection_under_acceleration():
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


def test_noise_of_a_sample_does_not_depend_on_those_before():
    machine = load_machine('xy_stage')
    early = observed(Plant(machine, 4, 'ideal'), Laser(machine, 7, 'hard'), np.zeros((1700, 2)))
    late = observed(Plant(machine, 4, 'ideal'), Laser(machine, 7, 'hard'), np.zeros((100, 2)), tick=1600)
    np.testing.assert_array_equal(early[1][-len(late[1]) :], late[1])


def test_laser_requires_zero_at_first_and_after_a_gap():
    plant = Plant(load_machine('planar'), 1, 'ideal')
    laser = Laser(plant.machine, 1, 'ideal')
    with pytest.raises(PkmError, match=r'tick 0 given; .* call zero'):
        laser.observe(0, plant.truth)
    laser.zero(0, plant.truth)
    for tick in range(1, 5):
        plant.tick([0.0, 0.0])
        laser.observe(tick, plant.truth)
    plant.reset()
    with pytest.raises(PkmError, match='tick 1 given; expected 5; call zero at first and after a gap'):
        laser.observe(1, plant.truth)
    laser.zero(9, plant.truth)
    plant.tick([0.0, 0.0])
    laser.observe(10, plant.truth)
    assert laser.read().time == pytest.approx([4.8e-3])


def test_laser_skips_the_time_at_rest_and_not_a_sample():
    """After 400 ticks at rest it measures the same bits, 0.2 s later; the noise goes on where it stopped."""
    machine, found = load_machine('four_dof'), {}
    for rest in (0, 400):
        plant = Plant(machine, 3)
        laser = Laser(machine, 3)
        early = observed(plant, laser, np.full((30, 4), 0.5))
        laser.stand(rest)
        for tick in range(31 + rest, 61 + rest):
            plant.tick(np.full(4, -0.5))
            laser.observe(tick, plant.truth)
        found[rest] = early, laser.read()
    assert np.array_equal(found[0][0][1], found[400][0][1])
    assert np.array_equal(found[0][1].displacement, found[400][1].displacement)
    np.testing.assert_allclose(found[400][1].time - found[0][1].time, 0.2, rtol=0.0, atol=1e-12)
