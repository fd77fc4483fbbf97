"""Exact workspace: orientations in closed form against the inverse kinematics and the Jacobian."""

import numpy as np
import pytest

from pkm_core.design.envelope import clearance, orientation_range, reached_with
from pkm_core.design.workspace import measure, pose_volume, sample_poses
from pkm_core.design.workspace_study import box
from pkm_core.errors import WorkspaceError
from pkm_core.machines import load_machine

FOUR_DOF = load_machine('four_dof')
LOWER, UPPER = box(FOUR_DOF)


def points(number, seed=5):
    return LOWER + (UPPER - LOWER) * np.random.default_rng(seed).random((number, 3))


def accepted(point, phi):
    try:
        FOUR_DOF.check_pose([*point, phi])
    except WorkspaceError:
        return False
    return True


def test_poses_of_the_travel_lie_in_the_orientation_range():
    poses = sample_poses(FOUR_DOF, 20_000, seed=2)
    at = orientation_range(FOUR_DOF, poses[:, :3])
    slack = 1e-7  # [rad] effect of ROUNDING at high sensitivity of phi
    assert (at.lowest <= poses[:, 3] + slack).all()
    assert (at.highest >= poses[:, 3] - slack).all()


def test_reached_orientations_agree_with_inverse_kinematics():
    scan, at = np.radians(np.linspace(-89.0, -1.0, 89)), points(100)
    brute = np.array([[accepted(point, phi) for phi in scan] for point in at])
    np.testing.assert_array_equal(np.stack([reached_with(FOUR_DOF, at, phi, phi) for phi in scan], axis=1), brute)
    found = orientation_range(FOUR_DOF, at)
    within = (scan >= found.lowest[:, np.newaxis]) & (scan <= found.highest[:, np.newaxis])
    assert not (brute & ~within).any()
    np.testing.assert_array_equal((brute ^ within).any(axis=1) & (found.gap == 0.0), False)


def test_gap_is_the_unreachable_part_of_a_range():
    poses = sample_poses(FOUR_DOF, 20_000, seed=2)[:, :3]
    at = orientation_range(FOUR_DOF, poses)
    split = int(np.nanargmax(at.gap))
    assert np.degrees(at.gap[split]) > 10.0
    scan = np.linspace(at.lowest[split], at.highest[split], 2001)
    share = np.mean([accepted(poses[split], phi) for phi in scan])
    width = at.highest[split] - at.lowest[split]
    assert 1.0 - share == pytest.approx(at.gap[split] / width, abs=2e-3)  # a step or two of the scan
    assert not reached_with(FOUR_DOF, poses[split], at.lowest[split], at.highest[split])


def test_volume_of_poses_is_the_integral_of_the_jacobian():
    """The volume [m^3 rad] from the orientation ranges equals that from the forward kinematics (substitution rule)."""

    def width(at):
        phi = orientation_range(FOUR_DOF, at)
        return np.nan_to_num(phi.highest - phi.lowest - phi.gap)

    inverse = measure(width, LOWER, UPPER, seed=1, points=1 << 14)
    assert inverse.value == pytest.approx(pose_volume(FOUR_DOF), abs=4.0 * inverse.error)
    assert inverse.error < 1e-3 * inverse.value


def test_clearance_is_positive_in_the_workspace_only():
    """At home it is half the travel, 20 mm."""
    at = points(4000)
    found = clearance(FOUR_DOF, at)
    np.testing.assert_array_equal(found >= 0.0, np.isfinite(orientation_range(FOUR_DOF, at).lowest))
    home = FOUR_DOF.forward(FOUR_DOF.home)
    assert clearance(FOUR_DOF, home[:3]) == pytest.approx(0.020, abs=1e-6)  # mid travel: 20 mm to either end
    assert (clearance(FOUR_DOF, [[0.09, 0.09, 0.3], [0.09, 0.09, -0.1]]) < 0.0).all()


def test_other_mechanisms_and_invalid_points_are_refused():
    with pytest.raises(WorkspaceError, match='planar is a planar'):
        orientation_range(load_machine('planar'), [0.1, 0.1, 0.1])
    with pytest.raises(WorkspaceError, match=r'shape \(2,\); expected \(\.\.\., 3\)'):
        clearance(FOUR_DOF, [0.1, 0.1])
    with pytest.raises(WorkspaceError, match='not finite'):
        reached_with(FOUR_DOF, [0.1, np.nan, 0.1], -1.0, -0.5)
