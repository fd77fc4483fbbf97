"""
The compiled servo tick of the plant: volts in, one sample time of physics, counts out; no allocation, no randomness.

Between the readings k and k+1 the drive applies the voltage computed from reading k-1 (a computation delay of one
sample), quantised, saturated and held. Each substep

- takes the exact mean of the current,
- evaluates the rigid machine at the middle of the substep and holds its acceleration (second order, no numerical
  damping),
- integrates viscous friction by the trapezoid rule, modes and windings by their exact solutions; modes that react on
  the machine (flexible.py) by the rule of the machine.

Kernels divide as numpy does (`error_model`): a check at every division would cost 20 % of the tick, and a
configuration that leads to a zero divisor is refused when it is loaded.
"""

import math

from numba import njit

from pkm_core.machines.dynamics import four_dof_terms, planar_terms, xy_stage_terms
from pkm_core.plant.arrays import AMPLIFIER, ENCODER, FLOOR, QD, QDD, REFUSED, Q
from pkm_core.plant.belts import four_dof_belt_terms
from pkm_core.plant.contact import contact_force
from pkm_core.plant.drive import current_step, dac_output, emf_step, limited_current, motor_thrust
from pkm_core.plant.encoder import encoder_count
from pkm_core.plant.flexible import bend, bend_forces
from pkm_core.plant.friction import bristle_step
from pkm_core.plant.modes import blend_steps, mode_step


@njit(cache=True, error_model='numpy')
def rigid_terms(mechanism, q, qd, p, M, C, G):
    """Fill M, C, G of the mechanism with this index in arrays.MECHANISMS."""
    if mechanism == 0:
        planar_terms(q, qd, p, M, C, G)
    elif mechanism == 1:
        xy_stage_terms(q, qd, p, M, C, G)
    elif mechanism == 2:
        four_dof_terms(q, qd, p, M, C, G)
    else:
        four_dof_belt_terms(q, qd, p, M, C, G)


@njit(cache=True, error_model='numpy')
def solve(M, b):
    """Overwrite `b` with the solution of M x = b; M is symmetric positive definite, its lower half is overwritten."""
    m = b.shape[0]
    for k in range(m):
        per_pivot = 1.0 / M[k, k]
        for i in range(k + 1, m):
            factor = M[i, k] * per_pivot
            for j in range(k + 1, i + 1):
                M[i, j] -= factor * M[j, k]
            b[i] -= factor * b[k]
        M[k, k] = per_pivot
    for k in range(m - 1, -1, -1):
        for i in range(k + 1, m):
            b[k] -= M[i, k] * b[i]
        b[k] *= M[k, k]


@njit(cache=True, error_model='numpy')
def _take_command(axis, common, volts, noise, shorted):
    """Apply the command of the previous tick and store `volts` for the next one."""
    applied = axis.command
    axis.command = dac_output(volts, common.voltage_limit, common.dac_step)
    axis.before = axis.demand
    wanted = common.ampere_per_volt * (applied + noise)
    limited = limited_current(wanted, axis.heat, common.continuous_current, common.peak_current)
    axis.demand = 0.0 if shorted else limited


@njit(cache=True, error_model='numpy')
def mean_current(axis, common, first, shorted):
    """Return the mean amplitude [A] over a substep; in the first one the previous demand acts until the delay ends."""
    h, lag = common.substep, common.current_lag
    if shorted:
        axis.current, charge = current_step(axis.current, 0.0, common.decay_winding, common.winding, h)
        return charge / h
    if not first:
        axis.current, charge = current_step(axis.current, axis.demand, common.decay, lag, h)
        return charge / h
    delay = common.current_delay
    axis.current, early = current_step(axis.current, axis.before, common.decay_delay, lag, delay)
    axis.current, late = current_step(axis.current, axis.demand, common.decay_rest, lag, h - delay)
    return (early + late) / h


@njit(cache=True, error_model='numpy')
def _axis_force(axis, parameters, common, position, speed, first, shorted):
    """Return thrust minus friction [N] over a substep with this position and speed at its middle."""
    current = mean_current(axis, common, first, shorted)
    axis.short_force, axis.loop_force, emf = emf_step(
        axis.short_force,
        axis.loop_force,
        speed,
        common.brake_damping if shorted else common.emf_damping,
        common.winding,
        common.decay_winding,
        common.current_lag,
        common.decay,
        common.substep,
        shorted,
    )
    axis.thrust = emf + motor_thrust(
        current, position, parameters.newton_per_ampere, common.ripple, common.cogging, common.pitch
    )
    axis.bristle, axis.friction = bristle_step(
        axis.bristle,
        speed,
        common.substep,
        parameters.coulomb,
        common.breakaway,
        common.stribeck_speed,
        common.bristle_stiffness,
        common.bristle_damping,
        common.elastic,
    )
    return axis.thrust - axis.friction


@njit(cache=True, error_model='numpy')
def _add_contacts(contacts, common, q, qd, force):
    """Add the contact forces to `force`; return the event of a closed contact, or 0."""
    event = 0
    for row in range(contacts.shape[0]):
        below, above = int(contacts[row, 0]), int(contacts[row, 1])  # -1 is the base
        gap = opening = 0.0
        if above >= 0:
            gap += q[above]
            opening += qd[above]
        if below >= 0:
            gap -= q[below]
            opening -= qd[below]
        depth = contacts[row, 2] - gap
        if depth > 0.0:
            push = contact_force(depth, -opening, common.contact_stiffness, common.contact_damping)
            if above >= 0:
                force[above] += push
            if below >= 0:
                force[below] -= push
            event = row + 1
    return event


@njit(cache=True, error_model='numpy')
def _bend(modes, steps, speed, acceleration):
    """Advance the modes of one joint in place."""
    for m in range(modes.shape[0]):
        modes[m, 0], modes[m, 1] = mode_step(modes[m, 0], modes[m, 1], steps[m], speed, acceleration)


@njit(cache=True, error_model='numpy')
def _read(axis, parameters, common, motion, i, modes, bends, scale, noise):
    """Return the present encoder count of joint `i`."""
    q, qd = motion[Q, i], motion[QD, i]
    axis.position, axis.speed = q, qd
    for m in range(modes.shape[0]):
        axis.position += modes[m, 0]
        axis.speed += modes[m, 1]
    if bends.shape[0] > 0:
        axis.position += scale[1, bends.shape[0]] * qd
        axis.speed += scale[1, bends.shape[0]] * motion[QDD, i]
    for m in range(bends.shape[0]):
        axis.position += scale[0, m] * bends[m, 0] + scale[1, m] * bends[m, 1]
        axis.speed += scale[0, m] * bends[m, 1] + scale[1, m] * bends[m, 2]
    seen = axis.position - common.encoder_latency * axis.speed + parameters.encoder_offset
    return int(encoder_count(seen, common.resolution, common.signal_period, common.subdivision_error, noise))


@njit(cache=True, error_model='numpy')
def advance(
    motion,
    axes,
    modes,
    counts,
    mechanism,
    rigid,
    parameters,
    common_row,
    contacts,
    mode_table,
    scratch,
    steps,
    bends,
    bend_parameters,
    scales,
    bend_scratch,
    volts,
    noise,
    row,
    substeps,
    shorted,
):
    """
    Advance the machine by one sample time; a voltage that is not finite leaves the state unchanged.

    Parameters
    ----------
    motion, axes, modes, counts, mechanism, rigid, parameters, common_row, contacts, mode_table, scratch, steps
        The fields of arrays.PlantArrays; the first four are the state.
    bends, bend_parameters, scales, bend_scratch
        The others; the first is also state.
    volts : ndarray, shape (n,)
        [V].
    noise : ndarray, shape (3, ticks, n)
        Rows ENCODER, AMPLIFIER, FLOOR.
    row : int
        The tick of `noise` to use.
    substeps : int
        Number per sample time.
    shorted : bool
        Phases shorted (brake) instead of driven.

    Returns
    -------
    event : int
        0, REFUSED, or 1 + the row of the contact that touched first.

    """
    n, m = axes.shape[0], motion.shape[1]
    common = common_row[0]
    h = common.substep
    M, C, G, q, qd, force = scratch[:m], scratch[m], scratch[m + 1], scratch[m + 2], scratch[m + 3], scratch[m + 4]
    for i in range(n):
        if not math.isfinite(volts[i]):
            return REFUSED
    for i in range(n):
        _take_command(axes[i], common, volts[i], noise[AMPLIFIER, row, i], shorted)
        if mode_table.shape[1] > 1:
            place = (motion[Q, i] - parameters[i].lower) / (parameters[i].upper - parameters[i].lower)
            blend_steps(mode_table[i], place, steps[i])

    event = 0
    for step in range(substeps):
        for i in range(m):
            q[i] = motion[Q, i] + 0.5 * h * motion[QD, i]
            qd[i] = motion[QD, i] + 0.5 * h * motion[QDD, i]
        rigid_terms(mechanism, q, qd, rigid, M, C, G)
        for i in range(m):
            force[i] = -C[i] - G[i]
        for i in range(n):
            viscous = parameters[i].viscous
            force[i] += _axis_force(axes[i], parameters[i], common, q[i], qd[i], step == 0, shorted)
            force[i] -= viscous * motion[QD, i]
            M[i, i] += parameters[i].extra_mass + 0.5 * h * viscous
        touched = _add_contacts(contacts, common, q, qd, force)
        event = touched if event == 0 else event
        if bends.shape[0] > 0:
            bend_forces(bends, bend_parameters, q, qd, h, M, force, bend_scratch)
        solve(M, force)  # now the acceleration
        if bends.shape[0] > 0:
            bend(bends, bend_parameters, force, h, bend_scratch)
        for i in range(n):
            # scale and carriages move with the floor: M (qdd + floor) = F, exact if a guide's joints carry all masses
            force[i] -= noise[FLOOR, row, i]
            _bend(modes[i], steps[i], motion[QD, i], force[i])
        for i in range(m):
            motion[QDD, i] = force[i]
            motion[Q, i] += h * (motion[QD, i] + 0.5 * h * force[i])
            motion[QD, i] += h * force[i]

    for i in range(n):
        axis = axes[i]
        axis.heat += common.heat_share * (0.5 * axis.current * axis.current - axis.heat)
        axis.square += axis.current * axis.current
        axis.rubbing += (axis.friction + parameters[i].viscous * motion[QD, i]) * motion[QD, i]
        counts[i] = _read(axis, parameters[i], common, motion, i, modes[i], bends, scales[:, i], noise[ENCODER, row, i])
    return event
