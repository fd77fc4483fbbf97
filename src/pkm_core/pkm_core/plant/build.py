"""Arrays of the compiled tick, built from the configuration: parameters, rest state, working arrays."""

import math

import numpy as np

from pkm_core.errors import ConfigError
from pkm_core.plant.arrays import AXIS_PARAMETERS, AXIS_STATE, COMMON_PARAMETERS, MECHANISMS, PlantArrays, Q
from pkm_core.plant.drive import motor_thrust, shorted_damping
from pkm_core.plant.flexible import no_bends
from pkm_core.plant.flexible_design import design_bends
from pkm_core.plant.modes import STEP_SIZE, mode_steps
from pkm_core.plant.tick import rigid_terms

_MODE_POINTS = 17  # table points over the travel, if modes depend on position


def build(machine, truth, levels, assembly):
    """
    Return the `PlantArrays` of `machine` for `truth`, the environment `levels` and the specimen `assembly`.

    The encoders read home and the machine is at rest. Friction (up to breakaway) and belts carry gravity and cogging.
    """
    n = len(machine.joints)
    m = n + (2 if levels.belts else 0)
    mechanism = machine.config.mechanism + ('_belts' if levels.belts else '')
    if mechanism not in MECHANISMS:
        raise ConfigError(f'truth of {machine.name}: belts is true; a {machine.config.mechanism} has no belts')
    rigid = _rigid(machine, truth, levels, assembly.payload)
    common = _common(machine, truth, levels)
    parameters = _axis_parameters(machine, truth, levels, assembly, common[0])
    mode_table = _mode_table(machine, truth, levels)
    scratch = np.zeros((m + 5, m))
    motion = np.zeros((3, m))
    motion[Q, :n] = machine.home - assembly.encoder_offset
    gravity = _settle_belts(motion[Q], n, MECHANISMS.index(mechanism), rigid, scratch, truth.belts)
    axes = np.zeros(n, AXIS_STATE)
    axes['position'] = motion[Q, :n]
    no_current = [
        motor_thrust(0.0, position, 0.0, levels.ripple, levels.cogging, truth.drive.pitch) for position in motion[Q, :n]
    ]
    sticks = truth.friction.breakaway * parameters['coulomb']
    axes['friction'] = np.clip(no_current - gravity, -sticks, sticks)
    axes['bristle'] = axes['friction'] / truth.friction.stiffness
    bends, scales = design_bends(machine, truth, levels, truth.substep) if levels.flexible else no_bends(n)
    return PlantArrays(
        motion=motion,
        axes=axes,
        modes=np.zeros((n, mode_table.shape[2], 2)),
        counts=np.round(machine.home / machine.encoder_resolution).astype(np.int64),
        mechanism=MECHANISMS.index(mechanism),
        rigid=rigid,
        parameters=parameters,
        common=common,
        contacts=_contacts(machine, truth.stops),
        mode_table=mode_table,
        scratch=scratch,
        steps=np.ascontiguousarray(mode_table[:, 0]),
        bends=np.zeros((bends.size, 3)),
        bend_parameters=bends,
        scales=scales,
        bend_scratch=np.zeros((bends.size, n + 1)),
    )


def drive_times(drive, substep):
    """Return the time constants of a truth.Drive and their decays over `substep` [s], COMMON_PARAMETERS by name."""
    lag = 1.0 / (2.0 * math.pi * drive.bandwidth)
    winding = drive.inductance / drive.resistance
    return {
        'substep': substep,
        'current_lag': lag,
        'current_delay': drive.delay,
        'decay_delay': math.exp(-drive.delay / lag),
        'decay_rest': math.exp(-(substep - drive.delay) / lag),
        'decay': math.exp(-substep / lag),
        'winding': winding,
        'decay_winding': math.exp(-substep / winding),
    }


def _common(machine, truth, levels):
    drive, friction = truth.drive, truth.friction
    nominal = machine.config.drive
    brake = shorted_damping(machine.thrust_per_volt / nominal.amplifier_gain, drive.resistance)
    values = {
        **drive_times(drive, truth.substep),
        'voltage_limit': machine.voltage_limit,
        'dac_step': 2.0 * machine.voltage_limit / 2**drive.dac_bits,
        'ampere_per_volt': nominal.amplifier_gain,
        'continuous_current': drive.continuous_current,
        'peak_current': nominal.peak_current,
        'heat_share': machine.sample_time / drive.thermal_time,
        'emf_damping': brake if levels.back_emf else 0.0,
        'brake_damping': brake,
        'ripple': levels.ripple,
        'cogging': levels.cogging,
        'pitch': drive.pitch,
        'breakaway': friction.breakaway,
        'stribeck_speed': friction.stribeck_speed,
        'bristle_stiffness': friction.stiffness,
        'bristle_damping': friction.damping,
        'elastic': friction.elastic,
        'contact_stiffness': truth.stops.stiffness,
        'contact_damping': truth.stops.damping,
        'resolution': machine.encoder_resolution,
        'signal_period': truth.signal_period,
        'subdivision_error': levels.subdivision_error,
        'encoder_latency': levels.encoder_latency,
    }
    return np.array([tuple(values[name] for name in COMMON_PARAMETERS.names)], COMMON_PARAMETERS)


def _axis_parameters(machine, truth, levels, assembly, common):
    axes = list(truth.axes.values())
    wrong = 1.0 if levels.model_error else 0.0
    listed = np.diagonal(machine.mass_matrix(machine.home))
    identified = [axis.gain is not None for axis in axes]
    total = np.where(identified, [machine.thrust_per_volt / (axis.gain or 1.0) for axis in axes], listed)
    # the current loop's response to the back EMF acts as a mass damping * lag (drive.emf_step); the identified mass
    # includes it
    extra = np.where(identified, total - listed - common['emf_damping'] * common['current_lag'], 0.0)
    for joint, axis, mass in zip(machine.joints, axes, extra, strict=True):
        if mass < 0.0:
            raise ConfigError(
                f'truth of {machine.name}: axes.{joint}.gain: {axis.gain * 1e3:g} mm/s^2/V given; the mass it implies '
                f'is {-mass:.3f} kg less than the mass of links and slider'
            )
    parameters = np.zeros(len(axes), AXIS_PARAMETERS)
    thrust_per_ampere = machine.thrust_per_volt / machine.config.drive.amplifier_gain
    parameters['newton_per_ampere'] = [thrust_per_ampere * (1.0 + wrong * axis.gain_error) for axis in axes]
    parameters['coulomb'] = levels.coulomb_friction
    parameters['extra_mass'] = extra
    parameters['viscous'] = [axis.viscosity * (1.0 + wrong * axis.viscosity_error) for axis in axes] * total
    parameters['encoder_offset'] = assembly.encoder_offset
    parameters['lower'] = machine.limits.lower
    parameters['upper'] = machine.limits.upper
    return parameters


def _rigid(machine, truth, levels, payload):
    values = np.array(machine.dynamic_parameters(), dtype=float)
    for name in truth.payload.carried_by:
        if name not in machine.parameters:
            known = list(machine.parameters)
            raise ConfigError(f'truth of {machine.name}: payload.carried_by: {name!r} is unknown; known: {known}')
        values[machine.parameters.index(name)] += payload
    return np.append(values, [truth.belts.stiffness, truth.belts.damping]) if levels.belts else values


def _contacts(machine, stops):
    rows = []
    for i, (lower, upper) in enumerate(zip(machine.limits.lower, machine.limits.upper, strict=True)):
        rows += [(-1, i, lower - stops.clearance), (i, -1, -upper - stops.clearance)]
    for pair in stops.carriages:
        rows.append((*(machine.joints.index(joint) for joint in pair), stops.carriage_length))
    return np.array(rows, dtype=float)


def _mode_table(machine, truth, levels):
    axes = list(truth.axes.values())
    count = max(len(axis.modes) for axis in axes) if levels.modes and not levels.flexible else 0
    points = _MODE_POINTS if count and levels.mode_shift else 1
    table = np.zeros((len(axes), points, count, STEP_SIZE))
    for i, axis in enumerate(axes if count else ()):
        lower, upper, home = machine.limits.lower[i], machine.limits.upper[i], machine.home[i]
        for k, place in enumerate(np.linspace(lower, upper, points) if points > 1 else [home]):
            stretch = 1.0 + levels.mode_shift * (place - home) / max(upper - home, home - lower)
            table[i, k, : len(axis.modes)] = mode_steps(axis.modes, truth.substep, stretch)
    return table


def _settle_belts(q, n, mechanism, rigid, scratch, belts):
    """Set the belt rotations q[n:] to equilibrium under gravity; return the gravity forces (n,) on the carriages."""
    m = q.size
    M, C, G = scratch[:m], scratch[m], scratch[m + 1]
    for _ in range(3):  # Newton steps; three suffice, as the belts are stiff compared with the weight
        rigid_terms(mechanism, q, np.zeros(m), rigid, M, C, G)
        if m > n:
            q[n:] -= (C[n:] + G[n:]) / belts.stiffness
    return G[:n].copy()
