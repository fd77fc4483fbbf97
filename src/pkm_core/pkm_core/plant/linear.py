"""
The simulated machine at rest as a linear system, from its truth: rigid machine, viscous friction, modes, current loop.

Without friction, noise, gain errors and payload. Judges compare margins with it; no controller may read it.
"""

import numpy as np
from scipy.linalg import expm

from pkm_core.plant.flexible_design import design_bends, home_terms, second_order
from pkm_core.plant.truth import load_truth


def sampled_plants(machine, environment, poses):
    """
    Return (A (N, N), B (N, n), C (n, N)) of the machine at rest at each of `poses` (k, n), voltages [V] to scales [m].

    Zero-order hold and the computation delay of one sample included. The `environment` selects the modes: in series or,
    with `flexible`, as masses on the links.
    """
    truth, levels = load_truth(machine, environment)
    bends = design_bends(machine, truth, levels) if levels.flexible else None
    return [_sampled(machine, truth, bends, q) for q in poses]


def pair_gaps(machine, q):
    """Return the distance (pairs,) [m] of the two sliders of each link pair at the joints `q` (n,)."""
    pairs = load_truth(machine, 'ideal')[0].stops.carriages
    return np.array([q[machine.joints.index(higher)] - q[machine.joints.index(lower)] for lower, higher in pairs])


def _sampled(machine, truth, bends, q):
    M, viscous = home_terms(machine, truth)
    extra = np.diagonal(M) - np.diagonal(machine.mass_matrix(machine.home))
    M = machine.mass_matrix(q) + np.diag(extra)
    parts = _shared(bends, q, M, viscous) if bends else _series(truth, M, viscous)
    mass, damping, stiffness, place, rate = parts
    n, size, corner = len(q), len(mass), 2.0 * np.pi * truth.drive.bandwidth
    inverse = np.linalg.inv(mass)
    A = np.zeros((2 * size + n,) * 2)
    A[:size, size : 2 * size] = np.eye(size)
    driven = machine.thrust_per_volt * inverse[:, :n]
    A[size : 2 * size] = np.hstack([-inverse @ stiffness, -inverse @ damping, driven])
    A[2 * size :, 2 * size :] = -corner * np.eye(n)
    B = np.vstack([np.zeros((2 * size, n)), corner * np.eye(n)])
    return _held(A, B, np.hstack([place, rate, np.zeros((n, n))]), machine.sample_time)


def _held(A, B, C, sample_time):
    """Return the system with zero-order hold and one sample of delay before it."""
    N, n = B.shape
    block = np.zeros((N + n, N + n))
    block[:N, :N], block[:N, N:] = A * sample_time, B * sample_time
    block = expm(block)
    block[N:] = 0.0
    return block, np.vstack([np.zeros((N, n)), np.eye(n)]), np.hstack([C, np.zeros((n, n))])


def _shared(bends, q, M, viscous):
    """Return the matrices of (q, eta) of flexible.py."""
    parameters, scales = bends
    n, f = len(q), parameters.size
    place = np.hstack([np.eye(n), scales[0, :, :f]])
    rate = np.hstack([np.diag(scales[1, :, f]), scales[1, :, :f]])
    return *second_order(parameters, q, M, viscous), place, rate


def _series(truth, M, viscous):
    """Return the matrices of (r, eta) of modes.py: eta'' + 2 z w eta' + w^2 eta = alpha r'' + beta r'."""
    n, rows = len(viscous), []
    for i, axis in enumerate(truth.axes.values()):
        modes = [[2 * np.pi * m.resonance, m.resonance_damping, 2 * np.pi * m.antiresonance, m.antiresonance_damping]
                 for m in axis.modes]  # fmt: skip
        for w, z, *_ in modes:
            pole = w * (-z + 1j * np.sqrt(1 - z * z))
            value = np.prod([
                (wr / wa) ** 2 * (pole**2 + 2 * za * wa * pole + wa**2) for wr, _, wa, za in modes
            ]) / np.prod([pole**2 + 2 * zr * wr * pole + wr**2 for wr, zr, *_ in modes if wr != w])  # fmt: skip
            value /= pole  # alpha p + beta: the numerator of H - 1 is p (alpha p + beta) at a pole
            alpha = value.imag / pole.imag
            rows.append((i, w, z, alpha, value.real - alpha * pole.real))
    f = len(rows)
    mass, damping, stiffness = (np.zeros((n + f, n + f)) for _ in range(3))
    mass[:n, :n], damping[:n, :n] = M, np.diag(viscous)
    for k, (i, w, z, alpha, beta) in enumerate(rows, n):
        mass[k, k], damping[k, k], stiffness[k, k] = 1.0, 2.0 * z * w, w * w
        mass[k, i], damping[k, i] = -alpha, -beta
    place = np.hstack([np.eye(n), np.zeros((n, f))])
    for k, (i, *_) in enumerate(rows, n):
        place[i, k] = 1.0
    return mass, damping, stiffness, place, np.zeros((n, n + f))
