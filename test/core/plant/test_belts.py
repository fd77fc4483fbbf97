"""Belt elasticity: agreement with the rigid machine, energy, and the figures of the thesis."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pkm_core.machines import load_machine
from pkm_core.machines.dynamics import four_dof_terms
from pkm_core.plant.belts import four_dof_belt_terms
from pkm_core.plant.plant import Plant


def terms(kernel, q, qd, p):
    n = q.size
    M, C, G = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    kernel(q, qd, p, M, C, G)
    return M, C, G


@pytest.mark.parametrize('slender', [0.0, 1.0])
def test_stiff_belts_give_the_rigid_machine(slender):
    machine = load_machine('four_dof')
    p = machine.dynamic_parameters()
    p[machine.parameters.index('slender')] = slender
    rng = np.random.default_rng(2)
    for _ in range(20):
        q, qd = machine.home + rng.uniform(-0.015, 0.015, 4), rng.normal(0.0, 0.3, 4)
        rigid = terms(four_dof_terms, q, qd, p)
        belted = terms(four_dof_belt_terms, np.append(q, [0, 0]), np.append(qd, [0, 0]), np.append(p, [100.0, 0.0]))
        for one, other in zip(rigid, belted, strict=True):
            np.testing.assert_allclose(other[(slice(4),) * one.ndim], one, atol=1e-14)


def test_undamped_belts_conserve_energy():
    machine = load_machine('four_dof')
    p = np.append(machine.dynamic_parameters(), [100.0, 0.0])
    geometry, masses = machine.config.geometry, machine.config.masses
    lifted = masses.m10 * geometry.r10 / geometry.k10 + masses.m12 * geometry.r12 / geometry.k10 + masses.mef
    assembly = Plant(machine, 1, 'ideal').truth.assembly

    def energy(x):
        q, qd = x[:6], x[6:]
        height = assembly.end_point(q[:4], q[4:])[2]
        return 0.5 * qd @ terms(four_dof_belt_terms, q, qd, p)[0] @ qd + 50.0 * q[4:] @ q[4:] + 9.81 * lifted * height

    def rate(_, x):
        M, C, G = terms(four_dof_belt_terms, x[:6], x[6:], p)
        return np.append(x[6:], np.linalg.solve(M, -C - G))

    start = np.concatenate([machine.home, [1e-3, -2e-3], [0.2, -0.1, 0.15, 0.1], [0.0, 0.0]])
    path = solve_ivp(rate, (0.0, 0.05), start, rtol=1e-10, atol=1e-12)
    assert np.abs(path.y[4:6]).max() > 1e-3
    energies = [energy(x) for x in path.y.T]
    assert np.ptp(energies) < 1e-9  # of 0.03 J in motion


@pytest.mark.parametrize(('rate', 'lag'), [(89.8, 30), (89.8, 330), (125.7, 150), (125.7, 210)])
def test_platforms_rotate_by_less_than_0p03_deg_and_return(rate, lag):
    # the force profiles of (5.22)-(5.25), 10.5 N, one period; bound from thesis 5.6
    plant = Plant(load_machine('four_dof'), 1, 'elastic')
    rest, largest = plant.truth.belts, 0.0
    for k in range(round(2.0 * np.pi / rate / 0.5e-3)):
        a, b = (10.5 / 11.05 * np.sin(rate * 0.5e-3 * k - phase) for phase in (0.0, np.radians(lag)))
        plant.tick([a, b, a, b])
        largest = max(largest, np.abs(plant.truth.belts).max())
    assert plant.fault is None
    assert 0.002 < np.degrees(largest) < 0.03
    list(plant.brake(400))
    assert np.degrees(np.abs(plant.truth.belts)).max() < 0.002
    assert np.degrees(np.abs(plant.truth.belts - rest)).max() < 2e-4
