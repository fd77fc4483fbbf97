"""Comparison of modules and layouts of chapter 2."""

import numpy as np
import pytest

from pkm_core.design.envelope import orientation_range
from pkm_core.design.layouts import _reached, compare, layout_figures, pairs_of
from pkm_core.design.workspace import pose_volume, sample_joints
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine


def test_figures_of_the_triangular_module_follow_from_the_thesis():
    """Base from travel and greatest height, workspace of Table 6.1, error (4.2)-(4.8) at home."""
    machine = load_machine('planar')
    found = layout_figures(machine, 2000, 1, 0.05)
    assert found.base == pytest.approx((0.1, np.sqrt(0.07**2 - 0.01**2) + 0.01), abs=1e-12)
    assert 1e6 * found.workspace.value == pytest.approx(392.0938, abs=1e-4)
    assert found.condition[0] == pytest.approx(np.linalg.cond(machine.jacobian(machine.home)), rel=1e-12)
    # d1, d3 by half the gap: the corners of the box are reached at the lower height
    height = np.sqrt(0.07**2 - 0.03**2)
    least, most = (np.sqrt(0.07**2 - (height + dy) ** 2) for dy in (3e-3, -3e-3))
    assert found.travel == pytest.approx(2 * [6e-3 + most - least], rel=1e-12)


def test_positions_reached_are_those_of_the_exact_envelope():
    """The general search over phi against the closed form of the orthogonal layout, at random points about it."""
    machine = load_machine('four_dof')
    points = machine.forward(sample_joints(machine, 3000, 1))[:, :3]
    points[::2] += np.random.default_rng(2).normal(0.0, 2e-3, (1500, 3))  # half of them partly outside
    expected = np.isfinite(orientation_range(machine, points).lowest)
    assert 0.5 < expected.mean() < 0.9
    np.testing.assert_array_equal(_reached(machine, pairs_of(machine), points), expected)


def test_every_sample_of_the_parallel_layout_is_reached():
    machine = load_machine('parallel_layout')
    points = machine.forward(sample_joints(machine, 2000, 1))[:, :3]
    assert _reached(machine, pairs_of(machine), points).all()
    assert not _reached(machine, pairs_of(machine), points + np.array([0.0, 0.0, 0.01])).any()


def test_orthogonal_layout_beats_the_parallel_one_as_stated():
    """Better conditioning and a larger workspace; the half base area of the thesis does not follow."""
    orthogonal, parallel = compare([load_machine('four_dof'), load_machine('parallel_layout')], 2000, 1, 0.05).values()
    assert orthogonal.conditioning > 1.3 * parallel.conditioning
    assert orthogonal.workspace.value > 1.2 * parallel.workspace.value
    assert orthogonal.area > parallel.area


def test_v_linkage_needs_a_larger_base_than_the_triangle():
    triangular, v = compare([load_machine('planar'), load_machine('v_linkage')], 2000, 1, 0.05).values()
    assert v.area > 1.3 * triangular.area
    assert v.workspace.value == pytest.approx(pose_volume(load_machine('v_linkage'), 32), rel=1e-9)


def test_machine_without_links_is_refused():
    with pytest.raises(PkmError, match='xy_stage: a xy_stage has no links; expected planar'):
        compare([load_machine('xy_stage')], 1000, 1, 0.05)


def test_two_machines_of_one_name_are_refused():
    with pytest.raises(PkmError, match='planar is given twice; expected different names'):
        compare([load_machine('planar')] * 2, 1000, 1, 0.05)
