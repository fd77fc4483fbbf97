"""
The compiled servo tick of the plant: volts in, one sample time of physics, counts out; no allocation, no randomness.

Between the reading k and k+1 the drive applies the voltage that answered reading k-1 (one whole sample of computation),
held, quantised, saturated. Each substep takes the exact mean of the current, evaluates the rigid machine at the middle of
the substep and holds its acceleration (second order; free of numerical damping), viscous friction by the trapezoid rule.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pkm_core.belts import four_dof_belt_terms
from pkm_core.drive import current_step, dac_output, emf_step, limited_current, motor_thrust
from pkm_core.dynamics import four_dof_terms, planar_terms, xy_stage_terms
from pkm_core.encoder import encoder_count
from pkm_core.flexible import blend_matrices, deflection, mode_step
from pkm_core.friction import lugre_step
from pkm_core.stops import contact_force

MECHANISMS = ('planar', 'xy_stage', 'four_dof', 'four_dof_belts')
REFUSED = -1  # event: a voltage is not finite; otherwise 0, or 1 + number of the contact


class State(NamedTuple):
    """All that changes; n joints, m >= n coordinates (joints [m], then belt rotations [rad])."""

    q: np.ndarray  # (m,) of the rigid machine
    qd: np.ndarray  # (m,)
    qdd: np.ndarray  # (m,) held over the last substep
    modes: np.ndarray  # (n, order) deflections [m] and rates [m/s], see flexible.py
    joints: np.ndarray  # (2, n) what the scale moves by: rigid position plus deflections [m], speed [m/s]
    bristle: np.ndarray  # (n,) of the friction [m]
    command: np.ndarray  # (n,) computed, not applied before the next tick [V]
    demand: np.ndarray  # (n,) amplitude the current loop follows [A]
    current: np.ndarray  # (n,) amplitude [A]
    short_force: np.ndarray  # (n,) see drive.emf_step [N]
    emf_loop: np.ndarray  # (n,) [N]
    heat: np.ndarray  # (n,) filtered square of the rms current [A^2]
    thrust: np.ndarray  # (n,) mean of the last substep [N]
    friction: np.ndarray  # (n,) mean of the last substep, against the motion [N]
    counts: np.ndarray  # (n,) int64, the reading


class Parameters(NamedTuple):
    """All that stays, except what start_cycle draws: `newton_per_ampere` and `coulomb`."""

    rigid: np.ndarray  # of the dynamics kernel
    extra_mass: np.ndarray  # (n,) [kg]
    viscous: np.ndarray  # (n,) [N s/m]
    newton_per_ampere: np.ndarray  # (n,) of amplitude
    coulomb: np.ndarray  # (n,) [N]
    contact: np.ndarray  # (contacts, 3): joint that is below, joint above (-1: the base), distance at touch [m]
    encoder_offset: np.ndarray  # (n,) [m]
    mode_table: np.ndarray  # (n, points over the travel, order, order + 2)
    travel: np.ndarray  # (2, n) lower, upper end [m]
    substeps: int
    substep: float  # [s]
    voltage_limit: float  # [V]
    dac_step: float  # [V]
    ampere_per_volt: float  # amplitude
    continuous_current: float  # rms [A]
    peak_current: float  # amplitude [A]
    emf_damping: float  # under current control, 0 where the back EMF is left out [N s/m]
    brake_damping: float  # with the phases shorted [N s/m]
    heat_share: float  # sample time over thermal time
    current_lag: float  # [s]
    current_delay: float  # [s]
    decay_delay: float  # exp(-duration / lag) of the current over the delay,
    decay_rest: float  # over the rest of the first substep,
    decay: float  # and over any other
    decay_winding: float  # of the winding over a substep
    ripple: float
    cogging: float  # [N]
    pitch: float  # [m]
    breakaway: float
    stribeck_speed: float  # [m/s]
    bristle_stiffness: float  # [N/m]
    bristle_damping: float  # [N s/m]
    contact_stiffness: float  # [N/m]
    contact_damping: float  # [s/m]
    resolution: float  # [m/count]
    signal_period: float  # [m]
    subdivision_error: float  # [m]
    encoder_latency: float  # [s]


class Scratch(NamedTuple):
    """Working arrays, their content of no meaning between ticks; `mode_matrices` are those of the present position."""

    M: np.ndarray  # (m, m)
    C: np.ndarray  # (m,)
    G: np.ndarray  # (m,)
    q: np.ndarray  # (m,) middle of the substep
    qd: np.ndarray  # (m,)
    force: np.ndarray  # (m,)
    before: np.ndarray  # (n,) demand of the last tick [A]
    mode_matrices: np.ndarray  # (n, order, order + 2)
    mode: np.ndarray  # (order,)


@njit(cache=True)
def rigid_terms(mechanism, q, qd, p, M, C, G):
    """Fill M, C, G of the mechanism with this index in MECHANISMS."""
    if mechanism == 0:
        planar_terms(q, qd, p, M, C, G)
    elif mechanism == 1:
        xy_stage_terms(q, qd, p, M, C, G)
    elif mechanism == 2:
        four_dof_terms(q, qd, p, M, C, G)
    else:
        four_dof_belt_terms(q, qd, p, M, C, G)


@njit(cache=True)
def solve(M, b):
    """Overwrite `b` with the solution of M x = b, M symmetric positive definite and overwritten by its Cholesky factor."""
    m = b.shape[0]
    for i in range(m):
        for j in range(i):
            total = M[i, j]
            for k in range(j):
                total -= M[i, k] * M[j, k]
            M[i, j] = total / M[j, j]
            b[i] -= M[i, j] * b[j]
        total = M[i, i]
        for k in range(i):
            total -= M[i, k] * M[i, k]
        M[i, i] = math.sqrt(total)
        b[i] /= M[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            b[i] -= M[k, i] * b[k]
        b[i] /= M[i, i]


@njit(cache=True)
def _take_commands(s, p, w, volts, amplifier_noise, shorted):
    for i in range(volts.shape[0]):
        applied = s.command[i]
        s.command[i] = dac_output(volts[i], p.voltage_limit, p.dac_step)
        w.before[i] = s.demand[i]
        wanted = p.ampere_per_volt * (applied + amplifier_noise[i])
        s.demand[i] = 0.0 if shorted else limited_current(wanted, s.heat[i], p.continuous_current, p.peak_current)


@njit(cache=True)
def _mean_current(s, p, w, i, first):
    if not first:
        s.current[i], charge = current_step(s.current[i], s.demand[i], p.decay, p.current_lag, p.substep)
        return charge / p.substep
    rest = p.substep - p.current_delay
    s.current[i], early = current_step(s.current[i], w.before[i], p.decay_delay, p.current_lag, p.current_delay)
    s.current[i], late = current_step(s.current[i], s.demand[i], p.decay_rest, p.current_lag, rest)
    return (early + late) / p.substep


@njit(cache=True)
def _axis_force(s, p, w, i, first, shorted):
    """Return the force on carriage i but for contacts: thrust, friction, the explicit half of viscous friction."""
    position, speed = w.q[i], w.qd[i]
    current = _mean_current(s, p, w, i, first)
    damping = p.brake_damping if shorted else p.emf_damping
    s.short_force[i], s.emf_loop[i], emf = emf_step(
        s.short_force[i], s.emf_loop[i], speed, damping, p.decay_winding, p.decay, shorted
    )
    s.thrust[i] = motor_thrust(current, position, p.newton_per_ampere[i], p.ripple, p.cogging, p.pitch) + emf
    s.bristle[i], s.friction[i] = lugre_step(
        s.bristle[i],
        speed,
        p.substep,
        p.coulomb[i],
        p.breakaway,
        p.stribeck_speed,
        p.bristle_stiffness,
        p.bristle_damping,
    )
    return s.thrust[i] - s.friction[i] - p.viscous[i] * s.qd[i]


@njit(cache=True)
def _add_contacts(p, w):
    """Add the contact forces to w.force; return the event of the last contact that touches, or 0."""
    event = 0
    for c in range(p.contact.shape[0]):
        below, above = int(p.contact[c, 0]), int(p.contact[c, 1])
        gap = (w.q[above] if above >= 0 else 0.0) - (w.q[below] if below >= 0 else 0.0)
        opening = (w.qd[above] if above >= 0 else 0.0) - (w.qd[below] if below >= 0 else 0.0)
        depth = p.contact[c, 2] - gap
        if depth > 0.0:
            force = contact_force(depth, -opening, p.contact_stiffness, p.contact_damping)
            if above >= 0:
                w.force[above] += force
            if below >= 0:
                w.force[below] -= force
            event = c + 1
    return event


@njit(cache=True)
def _move(s, p, w, mechanism, floor, first, shorted):
    """Advance the rigid machine by a substep; return the event."""
    n = s.current.shape[0]
    h = p.substep
    for i in range(s.q.shape[0]):
        w.q[i] = s.q[i] + 0.5 * h * s.qd[i]
        w.qd[i] = s.qd[i] + 0.5 * h * s.qdd[i]
    rigid_terms(mechanism, w.q, w.qd, p.rigid, w.M, w.C, w.G)
    for i in range(s.q.shape[0]):
        w.force[i] = -w.C[i] - w.G[i]
    for i in range(n):
        w.force[i] += _axis_force(s, p, w, i, first, shorted)
        w.M[i, i] += p.extra_mass[i] + 0.5 * h * p.viscous[i]
    event = _add_contacts(p, w)
    solve(w.M, w.force)
    for i in range(n):
        w.force[i] -= floor[i]  # the encoder moves with the floor: M (qdd + floor) = F
    for i in range(s.q.shape[0]):
        s.qdd[i] = w.force[i]
        s.q[i] += h * (s.qd[i] + 0.5 * h * s.qdd[i])
    return event


@njit(cache=True)
def _bend(s, p, w):
    """Advance the modes over the same substep, then the speeds they started from."""
    for i in range(s.current.shape[0]):
        mode_step(s.modes[i], w.mode_matrices[i], s.qd[i], s.qdd[i], w.mode)
    for i in range(s.q.shape[0]):
        s.qd[i] += p.substep * s.qdd[i]


@njit(cache=True)
def _read(s, p, encoder_noise):
    for i in range(s.current.shape[0]):
        bent, rate = deflection(s.modes[i])
        s.joints[0, i] = s.q[i] + bent
        s.joints[1, i] = s.qd[i] + rate
        seen = s.joints[0, i] - p.encoder_latency * s.joints[1, i] + p.encoder_offset[i]
        s.counts[i] = int(
            encoder_count(seen, p.resolution, p.signal_period, p.subdivision_error, encoder_noise[i])
        )


@njit(cache=True)
def advance(s, p, w, mechanism, volts, encoder_noise, amplifier_noise, floor, index, shorted):
    """
    Advance the state `s` by one sample time and return the event; rows `index` of the noise blocks are used.

    `shorted` applies the brake instead of the drive. With a voltage that is not finite nothing changes (REFUSED).
    """
    for i in range(volts.shape[0]):
        if not math.isfinite(volts[i]):
            return REFUSED
    _take_commands(s, p, w, volts, amplifier_noise[index], shorted)
    points = p.mode_table.shape[1]
    if points > 1:
        for i in range(volts.shape[0]):
            place = (s.q[i] - p.travel[0, i]) / (p.travel[1, i] - p.travel[0, i])
            blend_matrices(p.mode_table[i], place, w.mode_matrices[i])
    event = 0
    for step in range(p.substeps):
        touched = _move(s, p, w, mechanism, floor[index], step == 0, shorted)
        event = touched if event == 0 else event
        _bend(s, p, w)
    for i in range(volts.shape[0]):
        s.heat[i] += p.heat_share * (0.5 * s.current[i] * s.current[i] - s.heat[i])
    _read(s, p, encoder_noise[index])
    return event
