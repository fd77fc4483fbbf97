"""
Constants of the modes that react, such that each axis has its identified H_i at home.

Unknowns and conditions, at home with the voltages of the other axes at zero:

- stiffness and damping of each mode: the poles of the whole machine are those of all H_i (Newton's method);
- the shares w, v, u of each scale: the response of joint i to its own force has the residues of K_i H_i/(s (s + a_i))
  at the poles of its own H_i, and none at the poles of the other axes: there its scale is at a node. u makes the
  response fall with the square of the frequency, as that of a force on a mass.

A force on the other slider of a pair excites the mode all the same, and away from home the directions change.
"""

import numpy as np
from scipy.linalg import eig

from pkm_core.errors import ConfigError
from pkm_core.plant.arrays import BEND_PARAMETERS
from pkm_core.plant.flexible import direction

_STEPS, _CLOSE = 60, 1e-10  # of Newton's method; relative error of the poles


def home_terms(machine, truth):
    """Return M (n, n) [kg] at home, with identified masses on its diagonal, and viscous friction (n,) [N s/m]."""
    total = np.array([machine.thrust_per_volt / axis.gain for axis in truth.axes.values()])
    M = machine.mass_matrix(machine.home)
    np.fill_diagonal(M, total)
    return M, total * [axis.viscosity for axis in truth.axes.values()]


def design_bends(machine, truth, levels, substep=0.0):
    """
    Return (BEND_PARAMETERS (f,), scales (2, n, f + 1)) of the environment `levels`.

    Frequencies are lowered such that the integration with `substep` [s] has those of H_i; 0: exact time.

    Raises
    ------
    ConfigError
        If the masses exceed that of the machine, or no springs give these poles.

    """
    M, viscous = home_terms(machine, truth)
    parameters = _carried(machine, truth, levels.flexible, np.diagonal(M))
    _check_mass(machine, parameters, np.diagonal(M))
    modes = [[_slowed(mode, substep) for mode in axis.modes] for axis in truth.axes.values()]
    poles = np.array([_pole(w, z) for axis in modes for w, z, _, _ in axis])
    _tune(machine, parameters, M, viscous, poles)
    residues, inverse = _shapes(parameters, machine.home, M, viscous, poles)
    scales = np.array([
        _scale(i, residues[:, :, i], _targets(i, parameters, modes, M, viscous, poles), inverse[:, i], poles)
        for i in range(len(modes))
    ])  # fmt: skip
    return parameters, np.ascontiguousarray(scales.transpose(1, 0, 2))


def directions(parameters, q):
    """Return J (f, n) of all modes at `q`."""
    rows = np.zeros((parameters.size, len(q)))
    for m in range(parameters.size):
        direction(parameters[m], q, np.zeros(len(q)), rows[m])
    return rows


def second_order(parameters, q, M, viscous):
    """Return mass, damping and stiffness matrix of (q, eta), each (n + f, n + f), at rest at `q`."""
    coupling = directions(parameters, q) * parameters['mass'][:, None]
    mass = np.block([[M, coupling.T], [coupling, np.diag(parameters['mass'])]])
    damping = np.diag(np.concatenate([viscous, parameters['damping']]))
    stiffness = np.diag(np.concatenate([np.zeros(len(q)), parameters['stiffness']]))
    return mass, damping, stiffness


def _carried(machine, truth, flexible, total):
    """Return the parameters without springs and dampers."""
    rows, link = [], machine.dynamic_parameters()[0]
    pairs = [tuple(machine.joints.index(joint) for joint in pair) for pair in truth.stops.carriages]
    for i, axis in enumerate(truth.axes.values()):
        lower, higher = next(pair for pair in pairs if i in pair)
        half = 0.5 * (machine.home[higher] - machine.home[lower])
        slope = 0.5 * half / np.sqrt(link**2 - half**2)
        if slope == 0.0:
            raise ConfigError(
                f'truth of {machine.name}: flexible: the links of {machine.joints[i]} are parallel at home'
            )
        for way, _ in zip(flexible.directions, axis.modes, strict=True):
            share = flexible.shared
            along, across = (share, 0.0) if way == 'along' else (0.0, share / slope * (1.0 if i == lower else -1.0))
            rows.append((i, lower, higher, link, 1.0 - share, along, across, flexible.mass * total[i], 0.0, 0.0))
    return np.array(rows, BEND_PARAMETERS)


def _check_mass(machine, parameters, total):
    """Refuse modes with more mass than the axes, with every pair as wide as its travel allows."""
    q = machine.home.astype(float)
    for mode in parameters:
        lower, higher = int(mode['lower']), int(mode['higher'])
        widest = min(machine.limits.upper[higher] - machine.limits.lower[lower], 1.96 * mode['link'])
        q[lower], q[higher] = machine.home[lower], machine.home[lower] + widest
    J = directions(parameters, q) / np.sqrt(total)
    share = np.linalg.eigvalsh((J * parameters['mass'][:, None]).T @ J).max()
    if share >= 1.0:
        raise ConfigError(
            f'truth of {machine.name}: flexible.mass: the modes take {100 * share:.0f} % of the mass of the axes where '
            'a pair is widest; allowed below 100 %: less mass or less shared'
        )


def _slowed(mode, substep):
    """Return [rad/s] and dampings of poles and zeros of a mode, lowered for the integration."""
    w, a = (2.0 * np.pi * f for f in (mode.resonance, mode.antiresonance))
    if substep:
        w, a = (2.0 / substep * np.sin(0.5 * substep * each) for each in (w, a))
    return w, mode.resonance_damping, a, mode.antiresonance_damping


def _pole(w, damping):
    return w * (-damping + 1j * np.sqrt(1.0 - damping**2))


def _first_order(parameters, q, M, viscous):
    """Return A, inverse mass matrix of the whole machine as (q, eta, qd, eta')."""
    mass, damping, stiffness = second_order(parameters, q, M, viscous)
    inverse = np.linalg.inv(mass)
    size = len(mass)
    return np.block([[np.zeros((size, size)), np.eye(size)], [-inverse @ stiffness, -inverse @ damping]]), inverse


def _eigen(A, poles):
    """Return eigenvalues, left and right vectors (columns) of the oscillations, in the order of `poles`."""
    values, left, right = eig(A, left=True, right=True)
    found = [i for i in np.argsort(np.abs(values)) if values[i].imag > 0.2 * poles.imag.min()]
    if len(found) != poles.size:
        return None
    order = np.empty(poles.size, dtype=int)
    order[np.argsort(np.abs(poles))] = found
    left, right = left[:, order].conj(), right[:, order]
    return values[order], left / np.sum(left * right, axis=0), right


def _tune(machine, parameters, M, viscous, poles):
    """Set stiffness and damping in place, such that the machine has the `poles`."""
    n, f = len(viscous), poles.size
    parameters['stiffness'] = parameters['mass'] * np.abs(poles) ** 2
    parameters['damping'] = -2.0 * parameters['mass'] * poles.real
    for step in range(_STEPS):
        A, inverse = _first_order(parameters, machine.home, M, viscous)
        found = _eigen(A, poles)
        if found is None:
            break
        values, left, right = found
        off = values - poles
        if np.abs(off / poles).max() < _CLOSE:
            if (parameters['stiffness'] > 0.0).all() and (parameters['damping'] > 0.0).all():
                return
            break
        push = -left[n + f :].T @ inverse[:, n:]  # (pole, mode): change of a pole by a spring or damper
        slope = np.hstack([push * right[n : n + f].T, push * right[2 * n + f :].T])
        change = np.linalg.lstsq(np.vstack([slope.real, slope.imag]), np.concatenate([off.real, off.imag]), rcond=None)[
            0
        ]
        share = min(1.0, 0.2 * (step + 1))
        parameters['stiffness'] -= share * change[:f]
        parameters['damping'] -= share * change[f:]
    raise ConfigError(
        f'truth of {machine.name}: flexible: no springs and dampers give the resonances of axes.*.modes with mass '
        f'{100 * parameters["mass"][0] / M[0, 0]:g} % and these shares; allowed: less mass, less shared, or resonances '
        'farther apart'
    )


def _shapes(parameters, q, M, viscous, poles):
    """Return the residues (pole, coordinate, joint) by the force on each joint, and the inverse mass."""
    A, inverse = _first_order(parameters, q, M, viscous)
    n, size = len(viscous), len(inverse)
    _, left, right = _eigen(A, poles)
    B = np.vstack([np.zeros((size, n)), inverse[:, :n]])
    return np.einsum('cp,pj->pcj', right[:size], left.T @ B), inverse


def _targets(joint, parameters, modes, M, viscous, poles):
    """Return the residues (f,) of the series model, force on `joint` to its scale, at all poles."""
    targets = np.zeros(poles.size, dtype=complex)
    for m in np.flatnonzero(parameters['owner'] == joint):
        p = poles[m]
        value = np.linalg.inv(M * p * p + np.diag(viscous) * p)[joint, joint]
        for w, z, a, za in modes[joint]:
            value *= (w / a) ** 2 * (p * p + 2.0 * za * a * p + a * a)
            own = np.isclose(_pole(w, z), p, rtol=1e-12)
            value /= p - np.conj(p) if own else p * p + 2.0 * z * w * p + w * w
        targets[m] = value
    return targets


def _scale(joint, residues, targets, mobility, poles):
    """
    Return the shares (2, f + 1) of the scale of `joint`.

    `residues` (pole, coordinate) and `mobility` (coordinate,) [1/kg] are those of the force on this joint.
    """
    f, typical = poles.size, np.abs(poles).mean()  # typical weighs w and v alike
    n = residues.shape[1] - f
    left, bends = targets - residues[:, joint], residues[:, n:]
    rate = poles[:, None] / typical
    equations = np.hstack([bends, bends * rate, residues[:, joint : joint + 1] * rate])
    falling = np.concatenate([np.zeros(f), mobility[n:], mobility[joint : joint + 1]])  # of the response times s
    row = np.abs(equations).max()
    found = np.linalg.lstsq(
        np.vstack([equations.real / row, equations.imag / row, falling / np.abs(falling).max()]),
        np.concatenate([left.real, left.imag, [0.0]]) / row,
        rcond=1e-9,
    )[0]
    return np.array([[*found[:f], 0.0], found[f:] / typical])
