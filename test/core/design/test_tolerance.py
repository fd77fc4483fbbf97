"""Chapter 4: error matrices, objectives, optima and tables of the thesis; refusals with condition and numbers."""

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.design.error_matrix import check_reach, em_thesis, em_true, geometry_of, linkage
from pkm_core.design.objectives import objectives, reachable_magnification
from pkm_core.design.operational_workspace import load_operational_workspace
from pkm_core.design.optimisation import not_dominated, optimum, pareto_front
from pkm_core.design.specimen import end_point, error_names, sensitivities
from pkm_core.design.tolerance_study import design_on_workspace, study_tolerance
from pkm_core.design.workspace import sample_joints
from pkm_core.errors import ConfigError, PkmError, WorkspaceError
from pkm_core.machines import load_machine
from pkm_core.thesis.tolerances import ERRORS, OBJECTIVES

FOUR_DOF = load_machine('four_dof')
W = load_operational_workspace('chapter4')
ONE_ANGLE, ALL = W.workspace.poses_at_middle_angle(), W.workspace.poses()


@pytest.fixture(scope='module')
def study():
    return study_tolerance(W)


def test_error_matrix_at_home_has_the_reference_values():
    E = em_true(linkage(geometry_of(FOUR_DOF), FOUR_DOF.forward(FOUR_DOF.home)))
    E[3] *= 1e-3  # rad/mm
    expected = [
        [0.58333333, -0.58333333, 0.2766993, 0.2766993, -1.6080786, 1.6080786],
        [0.2766993, 0.2766993, -0.58333333, 0.58333333, 1.6080786, -1.6080786],
        [-0.04886658, 0.13705866, 0.13705866, -0.04886658, 0.51254124, 0.51254124],
        [0.02372213, -0.00845783, 0.00845783, -0.02372213, 0.0, 0.0],
    ]
    np.testing.assert_allclose(E, expected, atol=1e-8)  # digits given
    singular = np.linalg.svd(E, compute_uv=False)
    np.testing.assert_allclose(singular, [3.34325972, 0.93758597, 0.72274212, 0.03508096], atol=1e-8)


def test_true_error_matrix_is_the_derivative_of_the_mechanism():
    """The matrix of the thesis differs from the derivative in the z row only."""
    q = sample_joints(FOUR_DOF, 500, seed=1)
    at = linkage(geometry_of(FOUR_DOF), FOUR_DOF.forward(q))
    found = sensitivities(FOUR_DOF, q)
    difference = found[..., :6] - em_true(at)
    assert np.abs(difference[:, :3]).max() < 2e-9  # m/m; 1 um steps
    assert np.abs(difference[:, 3]).max() < 2e-6  # rad/m
    wrong = np.abs(found[..., :6] - em_thesis(at)).max(axis=(0, 2))
    assert wrong[2] > 0.1  # only in z
    assert wrong[[0, 1, 3]].max() < 2e-6


def test_encoder_errors_act_through_the_jacobian():
    """An error of dz shifts the end point in z only."""
    q = sample_joints(FOUR_DOF, 200, seed=1)
    np.testing.assert_allclose(sensitivities(FOUR_DOF, q, FOUR_DOF.joints), -FOUR_DOF.jacobian(q), atol=1e-7)
    dz = sensitivities(FOUR_DOF, q, ('dz',))[..., 0]
    np.testing.assert_allclose(dz, np.tile([0.0, 0.0, 1.0, 0.0], (200, 1)), atol=1e-9)


def test_specimen_refuses_unknown_errors():
    """Without errors it equals the drawing."""
    q = sample_joints(FOUR_DOF, 50, seed=1)
    np.testing.assert_allclose(end_point(FOUR_DOF, q, {}), FOUR_DOF.forward(q), atol=1e-15 * 100)
    with pytest.raises(PkmError, match=r"unknown errors \['l3'\]; known: \['l2', 'l4'"):
        end_point(FOUR_DOF, q, {'l3': 1e-6})
    with pytest.raises(PkmError, match='a xy_stage has no links'):
        error_names(load_machine('xy_stage'))


@pytest.mark.parametrize(
    ('variant', 'poses', 'f', 'f1', 'f2'),
    [
        ('thesis', ONE_ANGLE, 0.5616594437, 153.1250876168, 626.6267449337),
        ('thesis', ALL, 0.774305871, 552.78186332, 10038.3321),
        ('true', ONE_ANGLE, 0.6078125860, 192.3319338865, 791.9420256091),
        ('true', ALL, 0.8381471583, 702.8145156613, 10084.4305461860),
    ],
)
def test_objectives_of_the_initial_design(variant, poses, f, f1, f2):
    """Values of Table 4.1 and of an independent computation."""
    found = objectives(W.geometry(0.150, 0.150), poses, variant)
    assert (found.f, found.f1, found.f2) == pytest.approx((f, f1, f2), rel=1e-8)


OPTIMA = {  # k [mm] and value
    ('f', 'thesis', 'middle'): (119.25080, 0.010733484543),
    ('f1', 'thesis', 'middle'): (118.65505, 3.5349237445),
    ('f2', 'thesis', 'middle'): (116.82924, 3.6831889326),
    ('f', 'thesis', 'all'): (119.25062, 0.010732953323),
    ('f1', 'thesis', 'all'): (118.62671, 3.5389209482),
    ('f2', 'thesis', 'all'): (116.63593, 3.7007773610),
    ('f', 'true', 'middle'): (118.98469, 0.011302790006),
    ('f1', 'true', 'middle'): (117.83507, 3.6184697522),
    ('f2', 'true', 'middle'): (116.11555, 3.7650381665),
    ('f', 'true', 'all'): (118.98418, 0.011303423422),
    ('f1', 'true', 'all'): (117.80922, 3.6227210675),
    ('f2', 'true', 'all'): (116.06849, 3.7702116670),
}


def test_optima_have_the_reference_values(study):
    for key, (k10, value) in OPTIMA.items():
        best = study.objectives[key].optimum
        assert best.l2 == pytest.approx(0.070)  # on its bound
        assert 1e3 * best.k10 == pytest.approx(k10, abs=1e-4)  # the minimum is flat
        assert best.value == pytest.approx(value, rel=1e-9)


def test_table_4_1_is_reproduced_except_the_optimal_f(study):
    for name, grid in (('f', 'middle'), ('f1', 'middle'), ('f2', 'all')):
        initial, (l2, k10, value) = OBJECTIVES[name]
        ours = study.objectives[name, 'thesis', grid].optimum
        assert study.objectives[name, 'thesis', 'middle'].initial == pytest.approx(initial, abs=6e-4)
        assert (1e3 * ours.l2, 1e3 * ours.k10) == pytest.approx((l2, k10), abs=0.1)
        if name != 'f':  # printed 0.0293; no grid gives it
            assert ours.value == pytest.approx(value, abs=1e-3)


def test_tables_4_2_to_4_5_are_reproduced_in_every_cell(study):
    for title, rows in ERRORS.items():
        for name, printed in rows.items():
            for ours, theirs in zip(study.statistics[title, 'thesis'][name], printed, strict=True):
                expected = 0.0 if theirs is None else theirs  # lost: the mean of phi is 0 by symmetry
                last_digit = 10.0 ** -len(repr(expected).split('.')[1])  # some cells are truncated, not rounded
                assert 1e6 * ours == pytest.approx(expected, abs=1.01 * last_digit)


def test_true_z_error_is_twice_that_of_the_thesis(study):
    title = 'Table 4.5, optimum of f2'
    true, theirs = (study.statistics[title, variant]['z'] for variant in ('true', 'thesis'))
    assert 1e6 * true.minimum == pytest.approx(1.82, abs=0.01)
    assert 1e6 * true.maximum == pytest.approx(2.11, abs=0.01)
    assert true.mean > 2.0 * theirs.mean
    for name in ('x', 'y', 'phi'):
        assert study.statistics[title, 'true'][name] == study.statistics[title, 'thesis'][name]


def test_prototype_magnification_over_its_workspace():
    squares, together, worst = reachable_magnification(FOUR_DOF, 100_000, seed=1)
    assert squares.mean() == pytest.approx(13.3, abs=0.15)
    assert squares.min() == pytest.approx(6.5, abs=0.3)  # extremes of a sample
    assert 1e6 * worst.mean(axis=0) == pytest.approx([5.0, 5.0, 1.45, 69.0], rel=0.01)
    assert 1e6 * together[:, 2].min() == pytest.approx(1.09, abs=0.01)


def test_joints_needed_for_w_exceed_the_prototype_travel():
    needed = {name: rest for name, *rest in design_on_workspace(FOUR_DOF, W).joints_needed}
    assert [1e3 * v for v in needed['d1'][:2]] == pytest.approx([69.97483690, 99.59056289])
    assert [1e3 * v for v in needed['d3'][:2]] == pytest.approx([176.44623036, 203.43802592])


def test_no_design_of_the_pareto_front_is_dominated():
    front = pareto_front(W, ONE_ANGLE, points=25)
    costs = np.stack([front.size, front.f1, front.f2], axis=1)
    assert not_dominated(costs).all()
    assert (np.diff(front.size) >= 0.0).all()
    assert front.f1[0] > 2.0 * front.f1.min()  # small machines magnify errors
    check = objectives(W.geometry(front.l2, front.k10), ONE_ANGLE)
    np.testing.assert_array_equal(check.f1, front.f1)


def test_arm_scales_the_weight_of_an_angle():
    small, large = (objectives(W.geometry(0.07, 0.1166), ALL, arm=arm) for arm in (1e-3, 50e-3))
    assert large.f == pytest.approx(50.0 * small.f)  # one of the four factors
    assert large.f1 > small.f1


@pytest.mark.parametrize(
    ('l2', 'k10', 'message'),
    [
        (0.070, 0.095, r'k = 95 mm is too short: the pose \(85, 85, 97.5 mm, -47 deg\) needs k above 97.5 mm'),
        (0.050, 0.117, r'l = 50 mm is too short: the pose \(85, 97.5, 97.5 mm, -43 deg\) needs l above 53.392 mm'),
        (0.070, 0.160, r'k = 160 mm is too long: .* needs y1 - dy above 0 mm; it is -8.613 mm'),
        (0.070, np.nan, 'not finite'),
    ],
)
def test_links_out_of_reach_are_refused_with_numbers(l2, k10, message):
    with pytest.raises(WorkspaceError, match=message):
        check_reach(W.geometry(l2, k10), ALL)


def test_angles_of_another_assembly_are_refused(tmp_path):
    mirrored = load_operational_workspace(
        edited(tmp_path, 'first: -47 deg, last: -43 deg', 'first: 43 deg, last: 47 deg')
    )
    poses = mirrored.workspace.poses()
    with pytest.raises(WorkspaceError, match=r'another assembly: .* needs phi between -90 and 0 deg'):
        check_reach(W.geometry(0.07, 0.1166), poses)
    with pytest.raises(WorkspaceError, match='empty search'):
        optimum(mirrored, poses, 'f1')


def edited(tmp_path, old, new):
    text = (Configuration.of_environment().folder / 'design' / 'chapter4.yaml').read_text()
    assert old in text
    path = tmp_path / 'mine.yaml'
    path.write_text(text.replace(old, new, 1))
    return path


def test_search_without_a_reachable_design_is_refused(tmp_path):
    path = edited(tmp_path, 'k: {lower: 98 mm, upper: 160 mm}', 'k: {lower: 80 mm, upper: 90 mm}')
    with pytest.raises(WorkspaceError, match=r'empty search: .* k from 80 to 90 mm'):
        optimum(load_operational_workspace(path), ALL, 'f1')


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('x: {first: 85 mm, last: 97.5 mm', 'x: {first: 97.5 mm, last: 85 mm', 'first 0.0975 is not below last 0.085'),
        ('l: {lower: 70 mm, upper: 160 mm}', 'l: {lower: 160 mm, upper: 70 mm}', 'lower 160 mm is not below upper 70'),
        ('points: 4}', 'points: 0}', 'points'),
        ('z: {first: 96 mm', 'z: {first: .nan mm', 'workspace.z.first'),
        ('initial: {l: 150 mm', 'initial: {l: -150 mm', 'initial.l'),
    ],
)
def test_invalid_workspace_file_is_refused(old, new, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        load_operational_workspace(edited(tmp_path, old, new))


def test_machine_of_another_mechanism_is_refused():
    with pytest.raises(WorkspaceError, match='planar is a planar; the error matrix is that of a four_dof'):
        design_on_workspace(load_machine('planar'), W)
