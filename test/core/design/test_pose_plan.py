"""Poses of a calibration: D-optimal, inside the travel, deterministic; refusals name the weakest direction."""

import numpy as np
import pytest

from pkm_core.design.budget_monte_carlo import study_poses
from pkm_core.design.calibration import calibrate
from pkm_core.design.calibration_motion import calibration_motion
from pkm_core.design.information import weakest_direction, weighted_sensitivities
from pkm_core.design.measurement import Measurements, load_laser
from pkm_core.design.pose_plan import MARGIN, MOST_POSES, plan_poses, spread_poses
from pkm_core.design.tolerances import load_tolerances
from pkm_core.errors import PkmError, TrajectoryError, WorkspaceError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import LONGEST_CYCLE
from pkm_core.motion.trajectory import to_joints

MACHINES = [load_machine('four_dof'), load_machine('planar')]
TOLERANCES, LASER = load_tolerances(), load_laser()
of_each_machine = pytest.mark.parametrize('machine', MACHINES, ids=lambda machine: machine.name)


def plan(machine, count=20, seed=1):
    return plan_poses(machine, count, seed, TOLERANCES, LASER)


@of_each_machine
def test_plan_has_more_information_than_spread_poses(machine):
    q = machine.inverse(plan(machine))
    deviation = LASER.deviation(machine, q)

    def volume(at):  # log determinant of the information on all unknowns, less the datum
        _, rows = weighted_sensitivities(machine, at, TOLERANCES, deviation)
        rows = (rows - rows.mean(axis=0)).reshape(-1, rows.shape[2])
        return np.linalg.slogdet(np.eye(rows.shape[1]) + rows.T @ rows)[1]

    others = [study_poses(machine, 20, seed) for seed in range(20)]
    assert volume(q) > max(map(volume, others))
    weakest, _ = weakest_direction(machine, q, TOLERANCES, deviation)
    assert weakest > 1.3 * max(weakest_direction(machine, each, TOLERANCES, deviation)[0] for each in others)


@of_each_machine
def test_poses_are_inside_the_travel_and_differ(machine):
    q = machine.inverse(plan(machine, 40))
    width = machine.limits.upper - machine.limits.lower
    assert (q > machine.limits.lower + 0.9 * MARGIN * width).all()
    assert (q < machine.limits.upper - 0.9 * MARGIN * width).all()
    apart = np.abs(q[:, np.newaxis] - q).max(axis=2) + np.eye(len(q))
    assert apart.min() > 0.1e-3


def test_same_seed_gives_the_same_poses():
    machine = MACHINES[1]
    np.testing.assert_array_equal(plan(machine, seed=3), plan(machine, seed=3))
    assert not np.array_equal(plan(machine, seed=3), plan(machine, seed=4))


@pytest.mark.parametrize('count', [0, 4, MOST_POSES + 1])
def test_number_of_poses_out_of_range_is_refused(count):
    with pytest.raises(PkmError, match=f'{count} poses given; allowed 5 to 200 for four_dof'):
        plan(MACHINES[0], count)


@of_each_machine
def test_similar_poses_are_refused_with_the_weakest_direction(machine):
    q = machine.home + 0.02 * (study_poses(machine, 20, 1) - machine.home)
    seen = Measurements(q, machine.forward(q) - machine.forward(machine.home))
    with pytest.raises(
        PkmError, match=r'20 poses are too similar: singular value .* of the weakest direction .*l2.* d1'
    ):
        calibrate(machine, seen, TOLERANCES, LASER.deviation(machine, q))


@of_each_machine
def test_motion_rests_at_every_pose_within_a_cycle(machine):
    poses = spread_poses(machine, 70, 1)
    cycles = calibration_motion(machine, poses)
    assert len(cycles) == 2
    np.testing.assert_array_equal(np.concatenate([cycle.poses for cycle in cycles]), poses)
    for cycle in cycles:
        assert len(cycle.trajectory) * machine.sample_time <= LONGEST_CYCLE
        to_joints(machine, cycle.trajectory)  # within the limits of speed and thrust
        for pose, (begin, end) in zip(cycle.poses, cycle.windows, strict=True):
            assert (end - begin) * machine.sample_time == pytest.approx(0.1)
            np.testing.assert_allclose(
                cycle.trajectory.position[begin:end], np.tile(pose, (end - begin, 1)), atol=1e-12
            )
            assert not cycle.trajectory.velocity[begin - 100 : end].any()  # 50 ms of settling


@pytest.mark.parametrize(
    ('change', 'options', 'error', 'reason'),
    [
        ((3, 0, 0.3), {}, WorkspaceError, r'calibration: pose 3: .*d1 = .* mm; allowed 59.5 to 99.5 mm'),
        ((2, 1, np.nan), {}, WorkspaceError, r'calibration: pose 2: y = nan'),
        ((0, 0, 0.11), {'averaged': 0.2}, TrajectoryError, r'average over 0.2 s; allowed up to the rest, 0.15 s'),
        ((0, 0, 0.11), {'rest': 20.0}, TrajectoryError, r'rest of 20 s; allowed 10 s together'),
        ((0, 0, 0.11), {'move_time': 0.01}, TrajectoryError, r'shortest allowed move_time'),
    ],
)
def test_motion_outside_its_limits_is_refused(change, options, error, reason):
    planar = MACHINES[1]
    poses = spread_poses(planar, 5, 1)
    poses[change[:2]] = change[2]
    with pytest.raises(error, match=reason):
        calibration_motion(planar, poses, **options)
