"""
Flexible modes of one joint: the identified high-frequency dynamics H_i of (7.20).

H_i is in series with the rigid machine: the scale is at y = r + SUM eta_m, the rigid joint position r plus the
deflections of the modes. Partial fractions of (7.20) decouple the modes,

    H_i = 1 + SUM_m (alpha_m s^2 + beta_m s) / (s^2 + 2 z_m w_m s + w_m^2),
    eta_m'' + 2 z_m w_m eta_m' + w_m^2 eta_m = alpha_m r'' + beta_m r',

each excited by the motion of its joint. H_i(0) = 1: settled positions are those of the rigid machine.

Consequences:

- A mode exerts no force. The force balance is that of the rigid machine, whose mass is the identified total mass; the
  energy balance does not include the modes.
- Right-half-plane zeros (planar d3) can be represented.
- Modes of different joints do not couple.
"""

import numpy as np
from numba import njit
from scipy.linalg import expm

STEP_SIZE = 8  # numbers of one mode's step: rows (eta, eta') by columns (eta, eta', speed, acceleration)


def mode_steps(modes, substep, stretch=1.0):
    """
    Return the exact step of each mode, shape (len(modes), STEP_SIZE), for `mode_step`.

    Exact for constant joint acceleration over the substep, as in the integration of the rigid machine.

    Parameters
    ----------
    modes : sequence of truth.Mode
        Factors of H_i; their resonances must differ.
    substep : float
        [s].
    stretch : float
        Factor on all frequencies of H_i (position dependence).

    """
    resonances = [_factor(mode.resonance * stretch, mode.resonance_damping) for mode in modes]
    antiresonances = [_factor(mode.antiresonance * stretch, mode.antiresonance_damping) for mode in modes]
    gain = np.prod([r[2] / a[2] for r, a in zip(resonances, antiresonances, strict=True)])
    numerator = np.polysub(gain * _product(antiresonances), _product(resonances))[:-1]  # of (H - 1) / s
    steps = np.zeros((len(modes), STEP_SIZE))
    for m, resonance in enumerate(resonances):
        pole = np.roots(resonance)[0]
        residue = np.polyval(numerator, pole) / np.polyval(_product(resonances[:m] + resonances[m + 1 :]), pole)
        alpha = residue.imag / pole.imag
        beta = residue.real - alpha * pole.real
        system = np.zeros((4, 4))  # of (eta, eta', speed, acceleration)
        system[0, 1] = system[2, 3] = 1.0
        system[1] = [-resonance[2], -resonance[1], beta, alpha]
        steps[m] = expm(system * substep)[:2].ravel()
    return steps


def _factor(frequency, damping):
    w = 2.0 * np.pi * frequency
    return np.array([1.0, 2.0 * damping * w, w * w])


def _product(factors):
    product = np.ones(1)
    for factor in factors:
        product = np.polymul(product, factor)
    return product


@njit(cache=True, error_model='numpy')
def blend_steps(table, place, steps):
    """Fill `steps` with `table` (points, ...) at `place` in 0..1, linear between its points."""
    x = min(max(place, 0.0), 1.0) * (table.shape[0] - 1)
    below = min(int(x), table.shape[0] - 2)
    share = x - below
    for m in range(steps.shape[0]):
        for k in range(STEP_SIZE):
            steps[m, k] = (1.0 - share) * table[below, m, k] + share * table[below + 1, m, k]


@njit(cache=True, error_model='numpy')
def mode_step(deflection, rate, a, speed, acceleration):
    """Return (deflection [m], rate [m/s]) of a mode after a substep `a`, from the joint's `speed` at its start."""
    return (
        a[0] * deflection + a[1] * rate + a[2] * speed + a[3] * acceleration,
        a[4] * deflection + a[5] * rate + a[6] * speed + a[7] * acceleration,
    )
