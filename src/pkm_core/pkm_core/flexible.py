"""
Flexible modes of one joint: the identified high-frequency dynamics H_i of (7.20).

H_i stands in series: the encoder sees the rigid joint position r plus the deflections of the modes,

    y = r + SUM eta_m,    eta'' + 2 zr wr eta' + wr^2 eta = (g - 1) y_m'' + 2 (g za wa - zr wr) y_m',    g = (wr/wa)^2,

with y_m the position in front of mode m. Deflections are zero at rest and H_i(0) = 1, so settled positions are those of
the rigid machine. What this means: a mode is base-excited by the joint and pushes back on nothing. The force equilibrium
stays that of the rigid machine (whose mass is the identified, total one); the energy of a mode is not in its balance; a
right-half-plane zero (planar d3) is representable. Deflections of different joints do not couple.
"""

import numpy as np
from numba import njit
from scipy.linalg import expm


def mode_matrices(modes, substep, order, stretch=1.0):
    """
    Return the exact step of a cascade of modes, shape (order, order + 2): columns state, speed, acceleration.

    Exact for a joint whose acceleration is constant over the substep, which is how the rigid machine is integrated.

    Parameters
    ----------
    modes : sequence of truth.Mode
        Factors of H_i; the state is (eta_1, eta_1', eta_2, eta_2', ...).
    substep : float
        [s].
    order : int
        Rows wanted, at least 2 len(modes); spare rows stay zero.
    stretch : float
        Factor on all frequencies (position dependence).

    """
    used = 2 * len(modes)
    system = np.zeros((used + 2, used + 2))  # state, then speed and acceleration of the joint
    speed = np.zeros(used + 2)  # y_m' and y_m'' as rows over that vector
    speed[used] = 1.0
    acceleration = np.zeros(used + 2)
    acceleration[used + 1] = 1.0
    system[used, used + 1] = 1.0
    for m, mode in enumerate(modes):
        wr = 2.0 * np.pi * mode.resonance * stretch
        wa = 2.0 * np.pi * mode.antiresonance * stretch
        gain = (wr / wa) ** 2
        deflection, rate = 2 * m, 2 * m + 1
        system[deflection, rate] = 1.0
        system[rate] = (gain - 1.0) * acceleration + 2.0 * (
            gain * mode.antiresonance_damping * wa - mode.resonance_damping * wr
        ) * speed
        system[rate, deflection] -= wr * wr
        system[rate, rate] -= 2.0 * mode.resonance_damping * wr
        speed[rate] += 1.0
        acceleration = acceleration + system[rate]
    matrices = np.zeros((order, order + 2))
    step = expm(system * substep)
    matrices[:used, :used] = step[:used, :used]
    matrices[:used, order:] = step[:used, used:]
    return matrices


@njit(cache=True)
def blend_matrices(table, place, matrices):
    """Fill `matrices` with `table` (points, ...) at `place` in 0..1, linear between its points."""
    x = min(max(place, 0.0), 1.0) * (table.shape[0] - 1)
    below = min(int(x), table.shape[0] - 2)
    share = x - below
    for row in range(matrices.shape[0]):
        for column in range(matrices.shape[1]):
            matrices[row, column] = (1.0 - share) * table[below, row, column] + share * table[below + 1, row, column]


@njit(cache=True)
def mode_step(state, matrices, speed, acceleration, scratch):
    """Advance the modes of one joint in place from the joint's `speed` at the start and its constant `acceleration`."""
    order = state.shape[0]
    for row in range(order):
        total = matrices[row, order] * speed + matrices[row, order + 1] * acceleration
        for column in range(order):
            total += matrices[row, column] * state[column]
        scratch[row] = total
    for row in range(order):
        state[row] = scratch[row]


@njit(cache=True)
def deflection(state):
    """Return (deflection [m], its rate [m/s]) of the modes of one joint."""
    sum_position = 0.0
    sum_speed = 0.0
    for m in range(0, state.shape[0], 2):
        sum_position += state[m]
        sum_speed += state[m + 1]
    return sum_position, sum_speed
