"""docs/mechanism.md and docs/machine.md: their equations are those of the code, their numbers those of config."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from pkm_core.machines import FourDof, load_machine

ROOT = Path(__file__).resolve().parents[2]
FOUR_DOF = load_machine('four_dof')
ROW = re.compile(r'^\|(.*)\|$')


def documented_numbers():
    """Return [(page, file, key, value)] of every row below a heading 'key in FILE'; 'a.b, c' means a.b and a.c."""
    found = []
    for page in ('mechanism', 'machine'):
        file = None
        for line in (ROOT / 'docs' / f'{page}.md').read_text(encoding='utf-8').splitlines():
            row = ROW.match(line)
            cells = [cell.strip() for cell in row[1].split('|')] if row else ['']
            if cells[-1].startswith('key in '):
                file = cells[-1].removeprefix('key in ')
            elif not row:
                file = None
            elif file and set(cells[-1]) != {'-'}:
                first, *others = cells[-1].split(', ')
                keys = [first, *(f'{first.rpartition(".")[0]}.{other}' for other in others)]
                values = cells[-2].split(', ')  # one for all, or one each
                found += [(page, file, key, values[min(i, len(values) - 1)]) for i, key in enumerate(keys)]
    return found


def test_numbers_of_the_pages_are_those_of_the_configuration():
    numbers = documented_numbers()
    assert len(numbers) > 75
    files = {file: yaml.safe_load((ROOT / file).read_text(encoding='utf-8')) for _, file, _, _ in numbers}
    for page, file, key, value in numbers:
        configured = files[file]
        for part in key.split('.'):
            configured = configured[part]
        assert str(configured) == value, f'{page}.md: {key}'


def with_distinct_numbers():
    """Return the machine with no two masses, inertias or centres alike, so that no mix-up of symbols stays hidden."""
    rng, config = np.random.default_rng(5), FOUR_DOF.config
    changed = {}
    for part, prefix in (('masses', 'm'), ('inertias', 'I'), ('geometry', 'r')):
        old = getattr(config, part)
        new = {name: value * rng.uniform(0.7, 1.3) for name, value in old if name[0] == prefix and name[1] != 'o'}
        changed[part] = old.model_copy(update=new)
    changed['geometry'] = changed['geometry'].model_copy(update={'dx': 0.011, 'dy': 0.009, 'dz': 0.012})
    return FourDof(config.model_copy(update=changed), 'distinct')


@pytest.fixture
def states():
    rng = np.random.default_rng(6)
    q = rng.uniform(FOUR_DOF.limits.lower, FOUR_DOF.limits.upper, (50, 4))
    return zip(q, rng.uniform(-0.3, 0.3, q.shape), strict=True)


def kinematics_of_the_page(config, q):
    """Return pose, J_q, J_H and what else the page names, by its equations."""
    length, k, dx, dy, dz = (getattr(config.geometry, name) for name in ('l2', 'k10', 'dx', 'dy', 'dz'))
    d1, d3, d5, d7 = q
    g1, g2 = d3 - d1, d5 - d7
    x1, y1 = (d1 + d3) / 2, dy + np.sqrt(length**2 - g1**2 / 4)
    x2, y2 = dx + np.sqrt(length**2 - g2**2 / 4), (d5 + d7) / 2
    wx, wy = x2 - x1, y2 - y1
    w2 = wx**2 + wy**2
    Z = np.sqrt(k**2 - w2 / 4)
    pose = np.array([(x1 + x2) / 2, (y1 + y2) / 2, dz + Z, np.arctan(wy / wx)])
    c1, c2 = g1 / (4 * (y1 - dy)), g2 / (4 * (x2 - dx))
    J_q = np.array([[0.5, 0.5, 0, 0], [c1, -c1, 0, 0], [0, 0, -c2, c2], [0, 0, 0.5, 0.5]])
    J_H = np.array([
        [0.5, 0, 0.5, 0],
        [0, 0.5, 0, 0.5],
        np.array([wx, wy, -wx, -wy]) / (4 * Z),
        np.array([wy, -wx, -wy, wx]) / w2,
    ])  # fmt: skip
    return pose, J_q, J_H, (length, k, g1 / 2, g2 / 2, y1 - dy, x2 - dx, np.array([wx, wy]), Z, c1, c2)


def test_kinematics_of_the_page_are_those_of_the_code(states):
    machine = with_distinct_numbers()
    for q, _ in states:
        pose, J_q, J_H, (*_, Z, c1, c2) = kinematics_of_the_page(machine.config, q)
        np.testing.assert_allclose(machine.forward(q), pose, rtol=1e-12)
        np.testing.assert_allclose(machine.jacobian(q), J_H @ J_q, rtol=1e-11, atol=1e-12)
        assert np.linalg.det(J_H) == pytest.approx(-1 / (4 * Z), rel=1e-11)
        assert np.linalg.det(J_q) == pytest.approx(c1 * c2, rel=1e-11)


def test_inverse_of_the_page_is_that_of_the_code(states):
    machine = with_distinct_numbers()
    geometry = machine.config.geometry
    for q, _ in states:
        x, y, z, phi = machine.forward(q)
        R = np.sqrt(geometry.k10**2 - (z - geometry.dz) ** 2)
        x1, x2 = x + R * np.cos(phi), x - R * np.cos(phi)
        y1, y2 = y + R * np.sin(phi), y - R * np.sin(phi)
        h1, h2 = np.sqrt(geometry.l2**2 - (y1 - geometry.dy) ** 2), np.sqrt(geometry.l2**2 - (x2 - geometry.dx) ** 2)
        by_the_page = [x1 - h1, x1 + h1, y2 + h2, y2 - h2]
        np.testing.assert_allclose(by_the_page, q, atol=1e-12)
        np.testing.assert_allclose(machine.inverse([x, y, z, phi]), by_the_page, atol=1e-14)


def pair_of_the_page(low, high, names, config, length, h, hd, Y):
    """Return M (2, 2) and C (2,) of a pair of sliders; `names` are the links on the lower and the higher one."""
    (r_low, m_low, I_low), (r_high, m_high, I_high) = (
        (getattr(config.geometry, f'r{n}'), getattr(config.masses, f'm{n}'), getattr(config.inertias, f'I{n}'))
        for n in names
    )
    A = m_low * r_low**2 + I_low + m_high * r_high**2 + I_high
    a = A / (4 * Y**2)
    M_low = getattr(config.masses, low) + m_low - m_low * r_low / length + a
    M_high = getattr(config.masses, high) + m_high - m_high * r_high / length + a
    across = (m_low * r_low + m_high * r_high) / (2 * length) - a
    C = A * h * hd**2 / (2 * Y**4)
    return np.array([[M_low, across], [across, M_high]]), np.array([-C, C])


def dynamics_of_the_page(config, q, qd):
    """Return M, C, G by the page's equations."""
    _, J_q, J_H, (length, k, h1, h2, Y1, X2, w, Z, _, _) = kinematics_of_the_page(config, q)
    m, inertias, geometry = config.masses, config.inertias, config.geometry
    M, C = np.zeros((4, 4)), np.zeros(4)
    h1d, h2d = (qd[1] - qd[0]) / 2, (qd[2] - qd[3]) / 2
    for rows, low, high, names, h, hd, Y in (
        ([0, 1], 'm1', 'm3', (2, 4), h1, h1d, Y1),
        ([3, 2], 'm7', 'm5', (8, 6), h2, h2d, X2),
    ):
        M[np.ix_(rows, rows)], C[rows] = pair_of_the_page(low, high, names, config, length, h, hd, Y)
    R, (g_z, g_phi) = np.linalg.norm(w) / 2, J_H[2:]
    a, b = geometry.r10 / k, geometry.r12 / k
    m_PP = m.mp + m.m9 + m.m10 * (1 - a / 2) ** 2 + m.m12 * b**2 / 4 + m.mef / 4
    m_QQ = m.mq + m.m11 + m.m10 * a**2 / 4 + m.m12 * (1 - b / 2) ** 2 + m.mef / 4
    m_PQ = m.m10 * (1 - a / 2) * a / 2 + m.m12 * b / 2 * (1 - b / 2) + m.mef / 4
    m_z = m.m10 * a**2 + m.m12 * b**2 + m.mef
    I_t = inertias.I10 + inertias.I12
    I_z = inertias.I9 + inertias.I11 + I_t + inertias.Ief
    M_c = np.kron([[m_PP, m_PQ], [m_PQ, m_QQ]], np.eye(2))
    M_u = M_c + (m_z + I_t / R**2) * np.outer(g_z, g_z) + I_z * np.outer(g_phi, g_phi)
    ud = J_q @ qd
    wd = ud[2:] - ud[:2]
    Rd, zd, phid = w @ wd / (4 * R), g_z @ ud, g_phi @ ud
    y1b, x2b = -(h1d**2 + ud[1] ** 2) / Y1, -(h2d**2 + ud[2] ** 2) / X2
    ub, wb = np.array([0, y1b, x2b, 0]), np.array([x2b, -y1b])
    zb = -(zd**2 + (wd @ wd + w @ wb) / 4) / Z
    phib = (w[0] * wb[1] - w[1] * wb[0]) / (4 * R**2) - 2 * phid * Rd / R
    thetab = zb / R - zd * Rd / R**2
    f_u = M_c @ ub + g_z * (m_z * zb + I_t / R * thetab) + g_phi * I_z * phib
    G_u = g_z * (m.m10 * a + m.m12 * b + m.mef) * 9.81
    return M + J_q.T @ M_u @ J_q, C + J_q.T @ f_u, J_q.T @ G_u


def test_dynamics_of_the_page_are_those_of_the_code(states):
    machine = with_distinct_numbers()
    for q, qd in states:
        M, C, G = dynamics_of_the_page(machine.config, q, qd)
        np.testing.assert_allclose(machine.mass_matrix(q), M, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(machine.bias(q, qd), C, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(machine.gravity(q), G, rtol=1e-10, atol=1e-12)
