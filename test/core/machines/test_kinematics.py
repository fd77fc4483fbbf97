"""Forward, inverse, Jacobian, margins and refusals of every machine."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pkm_core.design.calibration import built_machine
from pkm_core.design.specimen import end_point
from pkm_core.errors import WorkspaceError
from pkm_core.jet import Jet
from pkm_core.machines import load_machine
from pkm_core.machines.built import FourDofBuilt

MACHINES = {name: load_machine(name) for name in ('four_dof', 'planar', 'xy_stage')}
FOUR_DOF, PLANAR = MACHINES['four_dof'], MACHINES['planar']
# built with errors of some 0.1 mm, a different one for each length
OFF = {'l2': 1e-4, 'l4': -0.7e-4, 'l6': 0.4e-4, 'l8': -1.1e-4, 'k10': 0.9e-4, 'k12': -0.6e-4, 'dx': 0.5e-4}
OFF |= {'dy': -0.3e-4, 'dz': 0.8e-4, 'd1': 0.6e-4, 'd3': -0.2e-4, 'd5': 0.1e-4, 'd7': -0.4e-4}
BUILT = built_machine(FOUR_DOF, OFF)
MACHINES |= {'four_dof built': BUILT, 'planar built': built_machine(PLANAR, OFF)}
every_machine = pytest.mark.parametrize('machine', MACHINES.values(), ids=MACHINES)


def random_joints(machine, rows, seed=1):
    return np.random.default_rng(seed).uniform(machine.limits.lower, machine.limits.upper, (rows, len(machine.joints)))


def pose_mm_deg(x, y, z, phi):
    return np.array([x * 1e-3, y * 1e-3, z * 1e-3, np.radians(phi)])


# worked examples, mm and deg; checked once against an independent derivation
FORWARD = [
    ((79.5, 139.5, 139.5, 79.5), (91.3727766016838, 91.3727766016838, 123.74694520616839, -45.0)),
    ((70.0, 130.0, 150.0, 85.0), (85.99899191909311, 95.3727766016838, 123.6218190199373, -57.67640327729739)),
    ((62.0, 155.0, 125.0, 95.0), (93.43698582794336, 86.16175643950535, 123.1388693067195, -57.71184678832934)),
]
INVERSE = [
    ((91.0, 92.0, 122.0, -44.0), (77.40952188876831, 151.24364337903495, 154.19707643523265, 74.85536157310422)),
    ((93.0, 90.0, 123.5, -50.0), (73.35827001358237, 146.97669812062162, 134.25184334802913, 86.6669782775162)),
    ((88.5, 94.25, 124.0, -42.5), (88.78533101932227, 124.32048837649772, 146.0932835031587, 75.49160437267409)),
]


@pytest.mark.parametrize(('q_mm', 'pose'), FORWARD)
def test_four_dof_forward_reaches_worked_example(q_mm, pose):
    # 14 printed digits of up to 160 mm
    np.testing.assert_allclose(FOUR_DOF.forward(np.array(q_mm) * 1e-3), pose_mm_deg(*pose), rtol=0, atol=1e-14)


@pytest.mark.parametrize(('pose', 'q_mm'), INVERSE)
def test_four_dof_inverse_reaches_worked_example(pose, q_mm):
    np.testing.assert_allclose(FOUR_DOF.inverse(pose_mm_deg(*pose)), np.array(q_mm) * 1e-3, rtol=0, atol=1e-14)


def test_planar_forward_reaches_worked_example():
    np.testing.assert_allclose(PLANAR.forward(PLANAR.home), [0.1095, 0.07324555320336759], rtol=0, atol=1e-16)


def test_xy_stage_pose_is_its_axes():
    np.testing.assert_array_equal(MACHINES['xy_stage'].forward([0.01, 0.03]), [0.01, 0.03])


@every_machine
@settings(deadline=None, max_examples=300)
@given(data=st.data())
def test_inverse_undoes_forward_anywhere_in_travel(machine, data):
    limits = zip(machine.limits.lower, machine.limits.upper, strict=True)
    q = np.array([data.draw(st.floats(lower, upper)) for lower, upper in limits])
    x = machine.forward(q)
    q_again = machine.inverse(x)
    assert np.abs(q_again - q).max() < 1e-12
    assert np.abs(machine.forward(q_again) - x).max() < 1e-12
    machine.check_pose(x)


@every_machine
def test_leading_axes_are_samples(machine):
    q = random_joints(machine, 12).reshape(3, 4, -1)
    x = machine.forward(q)
    qd = 0.1 * np.ones_like(q)
    np.testing.assert_array_equal(x[1, 2], machine.forward(q[1, 2]))
    np.testing.assert_array_equal(machine.inverse(x)[1, 2], machine.inverse(x[1, 2]))
    np.testing.assert_array_equal(machine.singularity_margin(q)[1, 2], machine.singularity_margin(q[1, 2]))
    # matrix products of one row and of many may be summed in a different order
    np.testing.assert_allclose(machine.jacobian(q)[1, 2], machine.jacobian(q[1, 2]), rtol=1e-15)
    np.testing.assert_array_equal(machine.mass_matrix(q)[1, 2], machine.mass_matrix(q[1, 2]))
    np.testing.assert_array_equal(machine.bias(q, qd)[1, 2], machine.bias(q[1, 2], qd[1, 2]))
    np.testing.assert_array_equal(machine.gravity(q)[1, 2], machine.gravity(q[1, 2]))


def test_four_dof_jacobian_matches_worked_example_at_home():
    expected = [
        [0.25, 0.25, -0.11858541225631422, 0.11858541225631422],
        [0.11858541225631422, -0.11858541225631422, 0.25, 0.25],
        [-0.020942818161047504, -0.05873942458164894, -0.05873942458164894, -0.020942818161047504],
        [10.166626298944142, 3.6247853533898796, -3.6247853533898796, -10.166626298944142],
    ]
    np.testing.assert_allclose(FOUR_DOF.jacobian(FOUR_DOF.home), expected, rtol=1e-12)


@every_machine
def test_jacobian_agrees_with_central_differences(machine):
    q, h = random_joints(machine, 50), 1e-6
    columns = [
        (machine.forward(q + h * e) - machine.forward(q - h * e)) / (2.0 * h) for e in np.eye(len(machine.joints))
    ]
    # rounding of a pose over the step, 1e-16 / 1e-6; the phi row reaches 100 rad/m
    np.testing.assert_allclose(machine.jacobian(q), np.stack(columns, axis=-1), rtol=1e-7, atol=1e-8)


@every_machine
def test_jacobian_agrees_with_jets(machine):
    q = random_joints(machine, 50)
    for i, direction in enumerate(np.eye(len(machine.joints))):
        velocity = machine.forward(Jet.from_derivatives(q, direction, 0.0, 0.0)).derivatives()[1]
        # a few roundings of entries up to 100 rad/m
        np.testing.assert_allclose(machine.jacobian(q)[..., i], velocity, rtol=1e-12, atol=1e-13)


def test_four_dof_jacobian_keeps_its_sign_over_the_travel():
    det = np.linalg.det(FOUR_DOF.jacobian(random_joints(FOUR_DOF, 20_000))) * 1e-3  # phi per mm, as in theory 2.3
    assert -5.87e-4 < det.min() < det.max() < -1.13e-5


@every_machine
def test_jets_keep_motion_through_inverse_and_back(machine):
    q = random_joints(machine, 20)
    rng = np.random.default_rng(2)
    motion = (q, *(scale * rng.standard_normal(q.shape) for scale in (0.2, 10.0, 1000.0)))
    again = machine.inverse(machine.forward(Jet.from_derivatives(*motion))).derivatives()
    for came, wanted, scale in zip(again, motion, (0.1, 0.2, 10.0, 1000.0), strict=True):
        # inverse and forward, through a Jacobian of condition up to 60
        np.testing.assert_allclose(came, wanted, rtol=0, atol=1e-11 * scale)


def test_jets_of_inverse_agree_with_differences_along_a_motion():
    h = 1e-3
    x0, x1 = pose_mm_deg(*INVERSE[0][0]), pose_mm_deg(*INVERSE[1][0])
    swing = 2.0 * np.pi * 3.0
    t = h * np.arange(-2, 3)[:, None]
    q = FOUR_DOF.inverse(0.5 * (x0 + x1) + 0.5 * (x1 - x0) * np.sin(swing * t))
    derivatives = (0.5 * (x0 + x1), 0.5 * (x1 - x0) * swing, 0.0, -0.5 * (x1 - x0) * swing**3)
    _, velocity, acceleration, jerk = FOUR_DOF.inverse(Jet.from_derivatives(*derivatives)).derivatives()
    # truncation of order h^4 (velocity, acceleration) and h^2 (jerk) at 3 Hz
    a, b, c, d, e = q
    np.testing.assert_allclose(velocity, (a - 8 * b + 8 * d - e) / (12 * h), rtol=1e-5)
    np.testing.assert_allclose(acceleration, (-a + 16 * b - 30 * c + 16 * d - e) / (12 * h**2), rtol=1e-4)
    np.testing.assert_allclose(jerk, (-a + 2 * b - 2 * d + e) / (2 * h**3), rtol=1e-2)


@pytest.mark.parametrize('machine', [FOUR_DOF, BUILT], ids=['drawn', 'built'])
def test_links_at_their_passive_angles_close_the_loops(machine):
    q = random_joints(machine, 100)
    angle = machine.passive_angles(q)
    g = machine.config.built or FourDofBuilt.as_drawn(machine.config.geometry)
    d1, d3, d5, d7 = (q - list(dict(g.marks).values())).T
    P = np.array([d1 + g.l2 * np.cos(angle['th2']), g.l2 * np.sin(angle['th2']) + g.dy])
    np.testing.assert_allclose(P[0], d3 + g.l4 * np.cos(angle['th4']), atol=1e-15)
    np.testing.assert_allclose(P[1], g.l4 * np.sin(angle['th4']) + g.dy, atol=1e-15)
    Q = np.array([g.l6 * np.cos(angle['th6']) + g.dx, d5 + g.l6 * np.sin(angle['th6'])])
    np.testing.assert_allclose(Q[0], g.l8 * np.cos(angle['th8']) + g.dx, atol=1e-15)
    np.testing.assert_allclose(Q[1], d7 + g.l8 * np.sin(angle['th8']), atol=1e-15)
    for foot, k, elevation, sense in ((P, g.k10, angle['theta10'], -1.0), (Q, g.k12, angle['theta12'], 1.0)):
        level = sense * k * np.cos(elevation)
        x, y = foot + level * np.array([np.cos(angle['phi']), np.sin(angle['phi'])])
        tip = np.stack([x, y, k * np.sin(elevation) + g.dz, angle['phi']], axis=-1)
        np.testing.assert_allclose(tip, machine.forward(q), atol=1e-15)


@pytest.mark.parametrize('name', ['four_dof', 'planar'])
def test_built_machine_has_the_pose_of_the_specimen(name):
    """Forward kinematics of measured lengths; `drawing` is the nominal machine."""
    drawn, built = MACHINES[name], MACHINES[f'{name} built']
    q = random_joints(drawn, 100)
    own = {*built.joints, *type(built.config.built).model_fields}
    np.testing.assert_allclose(built.forward(q), end_point(drawn, q, {k: OFF[k] for k in OFF if k in own}), atol=1e-15)
    assert np.abs(built.forward(q) - drawn.forward(q)).max() > 5e-5
    np.testing.assert_array_equal(built.drawing.forward(q), drawn.forward(q))
    np.testing.assert_array_equal(built.mass_matrix(q), drawn.mass_matrix(q))  # lengths enter the kinematics only


def test_planar_passive_angles_are_those_of_the_same_sliders():
    four, two = FOUR_DOF.passive_angles(FOUR_DOF.home), PLANAR.passive_angles(PLANAR.home)
    assert two == {name: four[name] for name in ('th2', 'th4')}


def test_passive_rates_come_from_jets():
    q, qd = Jet.from_derivatives(PLANAR.home, [0.1, -0.1], 0.0, 0.0), 0.2
    rate = PLANAR.passive_angles(q)['th2'].derivatives()[1]
    height = 0.06324555320336759  # cos th2 = gap / 2 l2, so the rate is -d(gap)/dt / (2 height)
    assert rate == pytest.approx(qd / (2.0 * height), rel=1e-12)


def test_singularity_margin_is_the_nearest_pivot_distance():
    assert PLANAR.singularity_margin(PLANAR.home) == pytest.approx(0.060, abs=1e-15)  # gap, 140 mm being flat
    assert FOUR_DOF.singularity_margin(FOUR_DOF.home) == pytest.approx(0.0512715303561314, abs=1e-15)  # PQ
    assert FOUR_DOF.singularity_margin([0.0995, 0.1195, 0.1395, 0.0795]) == pytest.approx(0.020, abs=1e-15)
    # stretched far beyond its travel: 132 mm of 140 mm
    assert PLANAR.singularity_margin([0.05, 0.182]) == pytest.approx(0.008, abs=1e-15)
    assert MACHINES['xy_stage'].singularity_margin([0.0, 0.0]) == np.inf


REFUSED_POSES = [
    ((91.0, 92.0, 130.0, -45.0), 'z = 130 mm; allowed 10 to 126.6 mm'),
    ((91.0, 92.0, 5.0, -45.0), 'z = 5 mm; allowed 10 to 126.6 mm'),
    ((91.0, 92.0, 124.0, 45.0), 'phi = 45 deg; allowed -90 to 0 deg (branch (2.15))'),
    ((91.0, 130.0, 124.0, -45.0), 'y1 = 112.'),
    ((130.0, 92.0, 124.0, -45.0), 'x2 = 112.'),
    ((91.0, 92.0, np.nan, -45.0), 'z = nan'),
    ((np.inf, 92.0, 124.0, -45.0), 'x = inf'),
]


@pytest.mark.parametrize(('pose', 'reason'), REFUSED_POSES)
def test_inverse_refuses_pose_out_of_reach(pose, reason):
    with pytest.raises(WorkspaceError) as refused:
        FOUR_DOF.inverse(pose_mm_deg(*pose))
    assert reason in str(refused.value)


def test_inverse_names_the_row_of_a_history():
    history = np.tile(FOUR_DOF.forward(FOUR_DOF.home), (9, 1))
    history[7, 2] = 0.130
    with pytest.raises(WorkspaceError, match='row 7: z = 130 mm'):
        FOUR_DOF.inverse(history)


def test_planar_inverse_refuses_pose_out_of_reach():
    with pytest.raises(WorkspaceError, match='y = 81 mm; allowed 10 to 80 mm'):
        PLANAR.inverse([0.1, 0.081])


REFUSED_JOINTS = [
    ([0.07, 0.22], 'd3 - d1 = 150 mm; allowed 0 to 140 mm'),
    ([0.12, 0.11], 'd3 - d1 = -10 mm; allowed 0 to 140 mm'),
    ([np.nan, 0.13], 'd3 - d1 = nan mm'),
]


@pytest.mark.parametrize(('q', 'reason'), REFUSED_JOINTS)
@pytest.mark.parametrize('method', ['forward', 'jacobian', 'singularity_margin', 'mass_matrix', 'gravity'])
def test_every_method_refuses_unreachable_joint_positions(method, q, reason):
    with pytest.raises(WorkspaceError) as refused:
        getattr(PLANAR, method)(q)
    assert reason in str(refused.value)


def test_four_dof_forward_refuses_other_assembly():
    with pytest.raises(WorkspaceError, match=r'x1 - x2 = .* \(branch \(2.15\)\)'):
        FOUR_DOF.forward([0.02, 0.08, 0.1395, 0.0795])


@every_machine
def test_check_joints_accepts_the_limits_themselves(machine):
    machine.check_joints(np.stack([machine.limits.lower, machine.limits.upper, machine.home]))


def test_check_joints_names_first_row_joint_value_and_travel():
    history = np.tile(FOUR_DOF.home, (5, 1))
    history[3, 0], history[4, 1] = 0.1000001, 0.1
    with pytest.raises(WorkspaceError, match=r'^row 3: d1 = 100\.0001 mm; allowed 59\.5 to 99\.5 mm \(travel\)$'):
        FOUR_DOF.check_joints(history)


def test_check_joints_refuses_nan_and_wrong_length():
    with pytest.raises(WorkspaceError, match='d5 = nan'):
        FOUR_DOF.check_joints([0.0795, 0.1395, np.nan, 0.0795])
    with pytest.raises(WorkspaceError, match=r'shape \(2,\); expected \(\.\.\., 4\)'):
        FOUR_DOF.check_joints([0.0795, 0.1395])


def test_check_pose_refuses_pose_beyond_the_travel():
    x = FOUR_DOF.forward([0.0795, 0.1395, 0.1605, 0.0795])
    FOUR_DOF.inverse(x)  # the links reach it
    with pytest.raises(WorkspaceError, match=r'd5 = 160\.5 mm; allowed 119\.5 to 159\.5 mm'):
        FOUR_DOF.check_pose(x)
