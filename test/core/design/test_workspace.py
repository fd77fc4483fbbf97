"""Workspace: Monte-Carlo slices, exact extremes and volumes, surfaces, refusals."""

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.design.surface import exact_surface, join_contours, tessellate
from pkm_core.design.workspace import extremes, pose_volume, sample_poses, slice_positions
from pkm_core.design.workspace_study import (
    box,
    box_against_thesis,
    exact_volume,
    monte_carlo,
    study_spatial,
    volume_with_orientations,
)
from pkm_core.errors import ConfigError, WorkspaceError
from pkm_core.machines import load_machine

FOUR_DOF, PLANAR, XY_STAGE = (load_machine(name) for name in ('four_dof', 'planar', 'xy_stage'))
SLICE, CELL = 0.4e-3, 0.5e-3


@pytest.fixture(scope='module')
def run():
    return monte_carlo(FOUR_DOF, 1_000_000, SLICE, CELL, seed=1)


def test_extremes_of_the_four_dof_have_the_reference_joints():
    ends = extremes(FOUR_DOF)
    expected = {
        'x': (74.24489742783179, (59.5, 119.5, 159.5, 59.5), 104.39101615137756, (99.5, 159.5, 119.5, 99.5)),
        'y': (74.24489742783179, (59.5, 159.5, 119.5, 59.5), 104.39101615137756, (99.5, 119.5, 159.5, 99.5)),
        'z': (119.6051030189855, (99.5, 159.5, 159.5, 99.5), 126.03213554730311, (59.5, 119.5, 119.5, 59.5)),
    }
    for name, (low, low_joints, high, high_joints) in expected.items():
        for end, value, joints in zip(ends[name], (low, high), (low_joints, high_joints), strict=True):
            assert 1e3 * end.value == pytest.approx(value, rel=1e-12)
            np.testing.assert_allclose(1e3 * end.joints, joints, rtol=1e-12)
    # the extremes of phi lie inside an edge of the travel, where its slope is 0
    assert [np.degrees(end.value) for end in ends['phi']] == pytest.approx([-75.0050, -14.9950], abs=1e-4)


def test_planar_workspace_has_the_area_of_its_travel():
    """The height differs from Table 7.5: 20.29 mm, not 21 mm."""
    assert 1e6 * exact_volume(PLANAR, seed=1).value == pytest.approx(392.0937986, abs=1e-6)
    ours, thesis = box_against_thesis(PLANAR)
    assert ours == pytest.approx((40.0, 20.292237447), rel=1e-9)
    assert thesis == (40.0, 21.0)
    assert box_against_thesis(XY_STAGE)[0] == pytest.approx((40.0, 40.0))


def test_exact_volume_has_the_reference_value():
    volume = exact_volume(FOUR_DOF, seed=1)
    assert 1e9 * volume.value == pytest.approx(1330.0, abs=10.0)  # uncertainty of the reference
    assert 1e9 * volume.error < 2.0
    assert volume == exact_volume(FOUR_DOF, seed=1)


def test_slices_follow_3_30_and_hold_every_sample(run):
    slices = run.slices
    assert len(slices.occupied) == 16
    assert slices.thickness == pytest.approx(np.ptp(run.positions[:, 2]) / 16)
    assert len(run.contours) == 16
    area = 1e6 * slices.projected_area()
    assert area == pytest.approx(593.0, rel=0.05)  # whole cells along an outline of 90 mm, a few without a sample


def test_cells_bracket_the_exact_volume(run):
    least, most = run.slices.bracket()
    assert least < 1335e-9 < most


def test_study_orders_the_volumes_of_the_four_dof(run):
    """Dexterous < constant orientation < exact < joined contours; under 2 % of the cells miss a sample."""
    study = study_spatial(FOUR_DOF, run, np.radians(-45.0), np.radians([-47.0, -43.0]), seed=1)
    volumes = {name: 1e9 * volume.value for name, volume in study.volumes.items()}
    exact = volumes['exact: closed form']
    assert volumes['exact: surface (marching cubes)'] == pytest.approx(exact, rel=0.005)  # cells of half a millimetre
    assert volumes['dexterous, -47 to -43 deg'] < volumes['constant orientation -45 deg'] < exact
    assert exact < volumes['0.5 mm cells, joined contours']
    assert study.missed < 0.02 * run.slices.occupied.sum()  # the sample density is low only at the bottom
    assert study.cut > study.missed


def test_surfaces_are_closed_and_enclose_the_volume(run):
    joined = join_contours(run.slices, run.contours)
    assert joined.is_watertight
    assert joined.is_winding_consistent
    assert joined.volume == pytest.approx(1e9 * run.slices.volume(), rel=0.05)  # tips, holes and loose parts
    exact = exact_surface(FOUR_DOF, *box(FOUR_DOF), steps=(32, 32, 16))
    assert exact.is_watertight
    assert exact.volume == pytest.approx(1335.0, rel=0.02)  # cells of 1 mm


def test_delaunay_baseline_depends_on_the_radius_kept(run):
    tessellation = tessellate(run.positions[:5000])
    assert tessellation.volume() > tessellation.volume(3e-3) > tessellation.volume(1e-3)
    hull = tessellation.surface()
    assert hull.is_watertight
    assert hull.volume == pytest.approx(1e9 * tessellation.volume())


def test_samples_depend_only_on_the_seed():
    first = sample_poses(FOUR_DOF, 1000, seed=3)
    np.testing.assert_array_equal(first, sample_poses(FOUR_DOF, 1000, seed=3))
    assert not np.array_equal(first, sample_poses(FOUR_DOF, 1000, seed=4))


def test_pose_volume_of_a_stage_is_its_travel():
    assert pose_volume(XY_STAGE) == pytest.approx(1.6e-3)


def test_unreachable_orientation_is_refused_with_the_range():
    with pytest.raises(WorkspaceError, match=r'empty workspace: .*-10 .*-75\.01 to -14\.99 deg'):
        volume_with_orientations(FOUR_DOF, *np.radians([-10.0, -10.0]), seed=1)
    with pytest.raises(WorkspaceError, match='from -43 to -47 deg: inverted'):
        volume_with_orientations(FOUR_DOF, *np.radians([-43.0, -47.0]), seed=1)


@pytest.mark.parametrize(
    ('positions', 'slice_height', 'cell', 'message'),
    [
        ([[0.0, 0.0, 0.0]], 0.0, 1e-3, r'slice height 0 mm; allowed above 0 mm'),
        ([[0.0, 0.0, 0.0]], 1e-3, np.nan, r'cell nan mm'),
        (np.zeros((0, 3)), 1e-3, 1e-3, '0 positions given'),
        ([[0.0, np.inf, 0.0]], 1e-3, 1e-3, 'all finite'),
        ([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], 1e-4, 1e-4, 'allowed up to 1e9: choose larger cells'),
    ],
)
def test_invalid_slices_are_refused(positions, slice_height, cell, message):
    with pytest.raises(WorkspaceError, match=message):
        slice_positions(positions, slice_height, cell)


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('l2: 70 mm', 'l2: 48 mm', r'joints.d3.upper 159.5 mm; allowed below joints.d1.lower \+ 2 l2 = 155.5 mm'),
        ('k10: 116.6 mm', 'k10: 45 mm', r'largest PQ in the travel is .* mm; allowed below 2 k10 = 90 mm'),
        ('d1: {lower: 59.5 mm', 'd1: {lower: 159.5 mm', r'lower 159.5 mm is not below upper 99.5 mm'),
        ('l2: 70 mm', 'l2: .inf mm', 'l2'),
    ],
)
def test_machine_out_of_reach_of_its_travel_is_refused(old, new, message, tmp_path):
    text = (Configuration.of_environment().folder / 'machines' / 'four_dof.yaml').read_text()
    for centre in (
        'r2: 43',
        'r4: 46',
        'r6: 43',
        'r8: 46',
        'r10: 64.35',
        'r12: 69.77',
    ):  # short links need near centres of mass
        text = text.replace(centre, f'{centre.split(":")[0]}: 20')
    path = tmp_path / 'mine.yaml'
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=message):
        load_machine(path)
