"""M, C, G of every machine: worked examples, an independent Lagrangian, energy, symmetry."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pkm_core.jet import Jet
from pkm_core.machines import FourDof, Planar, load_machine
from pkm_core.machines.dynamics import GRAVITY

FOUR_DOF, PLANAR, XY_STAGE = (load_machine(name) for name in ('four_dof', 'planar', 'xy_stage'))


def with_changes(machine, **parts):
    """Return the machine with numbers of its geometry, masses or inertias replaced, e.g. masses={'m1': 1.0}."""
    config = machine.config
    changed = {part: getattr(config, part).model_copy(update=numbers) for part, numbers in parts.items()}
    return type(machine)(config.model_copy(update=changed), machine.name)


def with_distinct_numbers(machine):
    """Return the machine with all masses, inertias and centres different: swapped links change the result."""
    rng = np.random.default_rng(3)
    parts = {}
    for part, prefix in (('masses', 'm'), ('inertias', 'I'), ('geometry', 'r')):
        numbers = dict(getattr(machine.config, part))
        parts[part] = {n: v * rng.uniform(0.7, 1.3) for n, v in numbers.items() if n.startswith(prefix)}
    return with_changes(machine, **parts)


SLENDER = with_changes(FOUR_DOF, inertias={'rods_about_vertical': 'slender'})
MACHINES = {
    'four_dof': FOUR_DOF,
    'four_dof slender': SLENDER,
    'four_dof distinct': with_distinct_numbers(FOUR_DOF),
    'four_dof slender distinct': with_distinct_numbers(SLENDER),
    'planar': PLANAR,
    'planar distinct': with_distinct_numbers(PLANAR),
    'xy_stage': XY_STAGE,
}
every_machine = pytest.mark.parametrize('machine', MACHINES.values(), ids=MACHINES)


def random_state(machine, rows, seed=4):
    rng = np.random.default_rng(seed)
    q = rng.uniform(machine.limits.lower, machine.limits.upper, (rows, len(machine.joints)))
    return q, rng.uniform(-0.3, 0.3, q.shape)


def travel_corners(machine):
    ends = np.stack([machine.limits.lower, machine.limits.upper])
    return np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, len(machine.joints))


# q [m], qd [m/s], M, C, G; from an independent derivation by virtual work
FOUR_DOF_EXAMPLES = [
    (
        [0.0795, 0.1395, 0.1395, 0.0795],
        [0.1, -0.05, 0.08, 0.03],
        [
            [0.8634011140756962, 0.07622475707414078, -0.015138839899240947, -0.02973329479995432],
            [0.07622475707414078, 0.8184522654305738, -0.018124973268613842, -0.015138839899240945],
            [-0.015138839899240947, -0.018124973268613842, 0.8221543578252075, 0.07357797587774284],
            [-0.02973329479995432, -0.015138839899240947, 0.07357797587774284, 0.8513317778989011],
        ],
        [-0.014361794523568635, 0.00396281539353366, 0.0004215711326488012, 0.0036090474340977037],
        [-0.0381961668987329, -0.10713080004816206, -0.10713080004816206, -0.0381961668987329],
    ),
    (
        [0.07, 0.13, 0.15, 0.085],
        [-0.2, 0.15, 0.05, 0.25],
        [
            [0.8660206033158248, 0.0853549086593251, -0.0044291769097422, -0.026717276398340192],
            [0.0853549086593251, 0.8261360892307981, -0.01539947512942997, -0.02091346473419803],
            [-0.0044291769097422, -0.015399475129429968, 0.8202139357733363, 0.05868630050211242],
            [-0.026717276398340192, -0.02091346473419803, 0.05868630050211242, 0.8476911501241854],
        ],
        [0.04473074469893475, 0.08200446161020097, -0.0053041629585903645, -0.10449944286957001],
        [-0.014065942932186248, -0.09830453634727984, -0.11824817193168131, -0.059342376122023775],
    ),
    (
        [0.062, 0.155, 0.125, 0.095],
        [0.3, 0.1, -0.2, -0.1],
        [
            [0.9137457156286236, 0.03938394619557977, -0.00571284149850967, -0.015425222262439316],
            [0.03938394619557978, 0.8548728774565031, -0.018853894372200072, -0.017380631831024937],
            [-0.00571284149850967, -0.01885389437220007, 0.8096641635813613, 0.07757669525904048],
            [-0.015425222262439316, -0.017380631831024937, 0.07757669525904048, 0.8143649471781129],
        ],
        [0.03770747649716202, 0.0716103025444399, -0.02197390626769757, -0.048511460127202095],
        [0.024672407766266558, -0.14608247938434707, -0.10938742009148716, -0.0827522688758065],
    ),
]
PLANAR_EXAMPLES = [  # q, qd, mp, (M11, M13, M33), C3 = -C1
    ([0.0795, 0.1395], [0.1, -0.05], 0.034, (0.7829142857142857, 0.0370285714285714, 0.7750285714285713), 0.00361125),
    ([0.07, 0.13], [-0.2, 0.15], 0.034, (0.7829142857142857, 0.037028571428571425, 0.7750285714285713), 0.01966125),
    (
        [0.062, 0.155],
        [0.3, 0.1],
        0.034,
        (0.802647387714103, 0.017295469428754057, 0.7947616734283887),
        0.021242182397892474,
    ),
    (
        [0.0795, 0.1395],
        [0.1, -0.05],
        0.0633,
        (0.7918874107142857, 0.0427054464285714, 0.7840016964285713),
        0.0043683574218750035,
    ),
]


@pytest.mark.parametrize(('q', 'qd', 'M', 'C', 'G'), FOUR_DOF_EXAMPLES)
def test_four_dof_terms_reach_worked_example(q, qd, M, C, G):
    np.testing.assert_allclose(FOUR_DOF.mass_matrix(q), M, rtol=1e-12)
    np.testing.assert_allclose(FOUR_DOF.bias(q, qd), C, rtol=1e-11)  # sums of opposite terms
    np.testing.assert_allclose(FOUR_DOF.gravity(q), G, rtol=1e-12)


@pytest.mark.parametrize(('q', 'qd', 'mp', 'M', 'C3'), PLANAR_EXAMPLES)
def test_planar_terms_reach_worked_example(q, qd, mp, M, C3):
    machine = with_changes(PLANAR, masses={'mp': mp})
    np.testing.assert_allclose(machine.mass_matrix(q), [[M[0], M[1]], [M[1], M[2]]], rtol=1e-12)
    np.testing.assert_allclose(machine.bias(q, qd), [-C3, C3], rtol=1e-12)
    np.testing.assert_array_equal(machine.gravity(q), [0.0, 0.0])


def test_xy_stage_moves_the_whole_y_axis_along_x():
    np.testing.assert_allclose(XY_STAGE.inverse_dynamics([0.01, 0.02], [0.1, 0.2], [1.0, 1.0]), [8.2, 3.0])


def energies(machine, q, qd):
    """
    Return kinetic and potential energy (T,) [J], link by link from positions and passive angles.

    Velocities come from Jets, so nothing of dynamics.py or of the Jacobian takes part.
    """
    joints = Jet.from_derivatives(q, qd, 0.0, 0.0)
    angle, values, kinetic = machine.passive_angles(joints), dict(machine.config.masses), 0.0
    values.update(dict(machine.config.geometry), **dict(machine.config.inertias))

    def rate(x):
        return x.derivatives()[1]

    def moving(mass, *point):
        return 0.5 * mass * sum(rate(x) ** 2 for x in point)

    def turning(inertia, theta):
        return 0.5 * inertia * rate(theta) ** 2

    for i, joint in enumerate(machine.joints):  # each slider and the link on it; guides 1, 3 along X and 5, 7 along Y
        number = int(joint[1])
        d, theta, link = joints[..., i], angle[f'th{number + 1}'], number + 1
        r = values[f'r{link}']
        along, across = (r * np.cos(theta), r * np.sin(theta)) if number < 5 else (r * np.sin(theta), r * np.cos(theta))
        kinetic += moving(values[f'm{number}'], d) + moving(values[f'm{link}'], d + along, across)
        kinetic += turning(values[f'I{link}'], theta)
    P = [0.5 * (joints[..., 0] + joints[..., 1]), values['l2'] * np.sin(angle['th2']) + values['dy']]
    if isinstance(machine, Planar):
        return kinetic + moving(values['mp'], *P), np.zeros(len(q))
    Q = [values['l2'] * np.cos(angle['th6']) + values['dx'], 0.5 * (joints[..., 2] + joints[..., 3])]
    kinetic += moving(values['mp'] + values['m9'], *P) + moving(values['mq'] + values['m11'], *Q)
    phi, theta, potential = angle['phi'], angle['theta10'], 0.0
    for foot, sense, rod in ((P, -1.0, '10'), (Q, 1.0, '12')):
        r, mass, inertia = (values[kind + rod] for kind in ('r', 'm', 'I'))
        level = sense * r * np.cos(theta)
        rise = r * np.sin(theta)
        kinetic += moving(mass, foot[0] + level * np.cos(phi), foot[1] + level * np.sin(phi), rise)
        slender = values['rods_about_vertical'] == 'slender'
        about_vertical = inertia * np.cos(theta).value ** 2 if slender else inertia
        kinetic += turning(inertia, theta) + turning(about_vertical, phi)
        potential += mass * GRAVITY * rise.value
    x, y, z, phi = (machine.forward(joints)[..., i] for i in range(4))
    kinetic += moving(values['mef'], x, y, z) + turning(values['Ief'] + values['I9'] + values['I11'], phi)
    return kinetic, potential + values['mef'] * GRAVITY * (z.value - values['dz'])


@pytest.mark.parametrize('machine', [m for m in MACHINES.values() if m is not XY_STAGE], ids=list(MACHINES)[:-1])
def test_mass_matrix_is_the_kinetic_energy_of_all_links(machine):
    q, qd = random_state(machine, 200)
    q = np.concatenate([q, travel_corners(machine)])[-200:]
    kinetic, _ = energies(machine, q, qd)
    np.testing.assert_allclose(0.5 * np.einsum('ti,tij,tj->t', qd, machine.mass_matrix(q), qd), kinetic, rtol=1e-13)


@pytest.mark.parametrize('machine', [m for m in MACHINES.values() if isinstance(m, FourDof)], ids=list(MACHINES)[:4])
def test_gravity_is_the_slope_of_the_potential_energy(machine):
    q, _ = random_state(machine, 50)
    h = 1e-5
    slope = [
        (energies(machine, q + h * e, 0.0)[1] - energies(machine, q - h * e, 0.0)[1]) / (2.0 * h) for e in np.eye(4)
    ]
    # rounding 1e-16 J / 1e-5 m and truncation of order h^2
    np.testing.assert_allclose(machine.gravity(q), np.stack(slope, axis=-1), rtol=1e-6, atol=1e-8)


@every_machine
def test_bias_is_that_of_the_mass_matrix(machine):
    """C = Mdot qd - grad(qd' M qd) / 2, Lagrange's equation."""
    q, qd = random_state(machine, 50)
    h = 1e-5
    slopes = [(machine.mass_matrix(q + h * e) - machine.mass_matrix(q - h * e)) / (2.0 * h) for e in np.eye(q.shape[1])]
    dM = np.stack(slopes)  # (n, T, n, n)
    C = np.einsum('kt,ktij,tj->ti', qd.T, dM, qd) - 0.5 * np.einsum('ti,ktij,tj->tk', qd, dM, qd)
    # rounding 1e-16 kg / 1e-5 m on forces of 0.1 N, truncation of order h^2 / (10 mm)^2
    np.testing.assert_allclose(machine.bias(q, qd), C, rtol=1e-5, atol=1e-7)


@every_machine
def test_mass_matrix_is_symmetric_and_positive_definite(machine):
    M = machine.mass_matrix(np.concatenate([travel_corners(machine), random_state(machine, 2000)[0]]))
    np.testing.assert_array_equal(M, np.swapaxes(M, -1, -2))
    assert np.linalg.eigvalsh(M).min() > 0.4  # a slider alone weighs 0.7 kg, 0.49 kg with distinct numbers


def test_four_dof_mass_is_largest_at_the_highest_end_effector():
    # extremes of a 17^4 grid over the travel, at its corners: PQ is longest in one, shortest in the other
    lightest = np.linalg.eigvalsh(FOUR_DOF.mass_matrix([0.0995, 0.1195, 0.1195, 0.0995]))[0]
    heaviest = np.linalg.eigvalsh(FOUR_DOF.mass_matrix([0.0595, 0.1195, 0.1195, 0.0595]))[-1]
    assert (lightest, heaviest) == pytest.approx((0.72870389, 1.34801676), rel=1e-8)


@every_machine
def test_free_motion_conserves_energy(machine):
    """0.5 s inside the travel, all sliders at different speeds; gravity and every bias term contribute."""
    n = len(machine.joints)
    p, M, C, G = machine.dynamic_parameters(), np.empty((n, n)), np.empty(n), np.empty(n)

    def rate(_, state):
        machine.terms(state[:n], state[n:], p, M, C, G)
        return np.concatenate([state[n:], np.linalg.solve(M, -C - G)])

    span = machine.limits.upper - machine.limits.lower
    q0 = machine.limits.lower + np.array([0.1, 0.9, 0.9, 0.1])[:n] * span
    start = np.concatenate([q0, np.array([0.05, -0.07, -0.06, 0.03])[:n]])
    path = solve_ivp(rate, (0.0, 0.5), start, method='DOP853', rtol=1e-12, atol=1e-14).y.T
    q, qd = path[:, :n], path[:, n:]
    machine.check_joints(q)
    assert np.ptp(q, axis=0).min() > 0.005
    kinetic = 0.5 * np.einsum('ti,tij,tj->t', qd, machine.mass_matrix(q), qd)
    potential = energies(machine, q, qd)[1] if n == 4 else 0.0
    total = kinetic + potential
    assert np.abs(total - total[0]).max() < 1e-8 * kinetic[0]
    assert n == 2 or np.ptp(potential) > 0.01 * kinetic[0]  # kinetic and potential energy were exchanged


@every_machine
def test_inverse_dynamics_is_the_sum_of_its_terms(machine):
    q, qd = random_state(machine, 5)
    qdd = random_state(machine, 5, seed=6)[1]
    force = np.einsum('tij,tj->ti', machine.mass_matrix(q), qdd) + machine.bias(q, qd) + machine.gravity(q)
    np.testing.assert_allclose(machine.inverse_dynamics(q, qd, qdd), force, rtol=1e-14)


@every_machine
def test_kernel_and_vectorised_terms_give_the_same_bits(machine):
    """The plant calls the kernel, controllers the method: both must compute the same machine."""
    (q,), (qd,) = random_state(machine, 1)
    n = len(machine.joints)
    M, C, G = np.full((n, n), np.nan), np.full(n, np.nan), np.full(n, np.nan)
    machine.terms(q, qd, machine.dynamic_parameters(), M, C, G)
    np.testing.assert_array_equal(M, machine.mass_matrix(q))
    np.testing.assert_array_equal(C, machine.bias(q, qd))
    np.testing.assert_array_equal(G, machine.gravity(q))


def test_slender_rods_resist_turning_less_than_isotropic_ones():
    difference = FOUR_DOF.mass_matrix(FOUR_DOF.home) - SLENDER.mass_matrix(SLENDER.home)
    J_phi = FOUR_DOF.jacobian(FOUR_DOF.home)[3]
    inertias, elevation = FOUR_DOF.config.inertias, FOUR_DOF.passive_angles(FOUR_DOF.home)['theta10']
    saved = (inertias.I10 + inertias.I12) * np.sin(elevation) ** 2
    np.testing.assert_allclose(difference, saved * np.outer(J_phi, J_phi), rtol=1e-9)
