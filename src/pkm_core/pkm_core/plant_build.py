"""From configuration to arrays: the parameters, working arrays and rest state the compiled tick runs on."""

import math

import numpy as np

from pkm_core.drive import shorted_damping
from pkm_core.errors import ConfigError
from pkm_core.flexible import mode_matrices
from pkm_core.plant_tick import MECHANISMS, Parameters, Scratch, State, rigid_terms

_MODE_POINTS = 17  # over the travel, where modes depend on position


def build(machine, truth, levels, assembly):
    """
    Return (mechanism, parameters, scratch, rest state) of the plant in an environment.

    Parameters
    ----------
    machine : Machine
    truth : Truth
    levels : Environment
    assembly : Assembly

    Returns
    -------
    mechanism : int
        Index in plant_tick.MECHANISMS.
    parameters : Parameters
    scratch : Scratch
    state : State
        At home by the encoders, at rest, gravity carried by friction and belts as far as they can.

    """
    mechanism = MECHANISMS.index(machine.config.mechanism + ('_belts' if levels.belts else ''))
    parameters = _parameters(machine, truth, levels, assembly)
    n, order = parameters.mode_table.shape[0], parameters.mode_table.shape[2]
    m = n + (2 if levels.belts else 0)
    scratch = Scratch(
        M=np.zeros((m, m)),
        C=np.zeros(m),
        G=np.zeros(m),
        q=np.zeros(m),
        qd=np.zeros(m),
        force=np.zeros(m),
        before=np.zeros(n),
        mode_matrices=np.ascontiguousarray(parameters.mode_table[:, 0]),
        mode=np.zeros(order),
    )
    return mechanism, parameters, scratch, _rest(mechanism, parameters, scratch, machine.home, truth.belts)


def _parameters(machine, truth, levels, assembly):
    drive, friction, stops = truth.drive, truth.friction, truth.stops
    axes, sure = list(truth.axes.values()), 1.0 if levels.model_error else 0.0
    n, h = len(axes), truth.substep
    thrust_per_ampere = machine.thrust_per_volt / machine.config.drive.amplifier_gain
    lag = 1.0 / (2.0 * math.pi * drive.bandwidth)
    brake = shorted_damping(thrust_per_ampere, drive.resistance)
    emf = brake if levels.back_emf else 0.0
    listed = np.diagonal(machine.mass_matrix(machine.home))
    total = np.array([machine.thrust_per_volt / axis.gain if axis.gain else mass for axis, mass in zip(axes, listed, strict=True)])
    extra = total - listed - emf * lag  # the loop's answer to the back EMF weighs emf * lag, see drive.emf_step
    for joint, axis, mass in zip(machine.joints, axes, extra, strict=True):
        if axis.gain and mass < 0.0:
            raise ConfigError(
                f'truth of {machine.name}: axes.{joint}.gain {axis.gain:g} m/s^2/V needs a mass {mass:.3f} kg below that listed'
            )
    viscosity = np.array([axis.viscosity * (1.0 + sure * axis.viscosity_error) for axis in axes])
    gain_error = np.array([sure * axis.gain_error for axis in axes])
    return Parameters(
        rigid=_rigid(machine, truth, levels, assembly.payload),
        extra_mass=np.where([axis.gain is not None for axis in axes], extra, 0.0),
        viscous=viscosity * total,
        newton_per_ampere=thrust_per_ampere * (1.0 + gain_error),
        coulomb=np.full(n, levels.friction),
        contact=_contacts(machine, stops),
        encoder_offset=assembly.encoder_offset,
        mode_table=_mode_table(machine, axes, levels, h),
        travel=np.array([machine.limits.lower, machine.limits.upper]),
        substeps=round(machine.sample_time / h),
        substep=h,
        voltage_limit=machine.voltage_limit,
        dac_step=2.0 * machine.voltage_limit / 2**drive.dac_bits,
        ampere_per_volt=machine.config.drive.amplifier_gain,
        continuous_current=drive.continuous_current,
        peak_current=machine.config.drive.peak_current,
        emf_damping=emf,
        brake_damping=brake,
        heat_share=machine.sample_time / drive.thermal_time,
        current_lag=lag,
        current_delay=drive.delay,
        decay_delay=math.exp(-drive.delay / lag),
        decay_rest=math.exp(-(h - drive.delay) / lag),
        decay=math.exp(-h / lag),
        decay_winding=math.exp(-h * drive.resistance / drive.inductance),
        ripple=levels.ripple,
        cogging=levels.cogging,
        pitch=drive.pitch,
        breakaway=friction.breakaway,
        stribeck_speed=friction.stribeck_speed,
        bristle_stiffness=friction.stiffness,
        bristle_damping=friction.damping,
        contact_stiffness=stops.stiffness,
        contact_damping=stops.damping,
        resolution=machine.encoder_resolution,
        signal_period=truth.signal_period,
        subdivision_error=levels.subdivision_error,
        encoder_latency=levels.encoder_latency,
    )


def _rigid(machine, truth, levels, payload):
    values = np.array(machine.dynamic_parameters(), dtype=float)
    for name in truth.payload.carried_by:
        if name not in machine.parameters:
            raise ConfigError(f'truth of {machine.name}: payload.carried_by has {name!r}; known: {list(machine.parameters)}')
        values[machine.parameters.index(name)] += payload
    return np.append(values, [truth.belts.stiffness, truth.belts.damping]) if levels.belts else values


def _contacts(machine, stops):
    rows = []
    for i in range(len(machine.joints)):
        rows.append((-1, i, machine.limits.lower[i] - stops.clearance))
        rows.append((i, -1, -machine.limits.upper[i] - stops.clearance))
    for pair in stops.carriages:
        rows.append((*(machine.joints.index(joint) for joint in pair), stops.carriage_length))
    return np.array(rows, dtype=float)


def _mode_table(machine, axes, levels, substep):
    order = 2 * max(len(axis.modes) for axis in axes) if levels.modes else 0
    points = _MODE_POINTS if order and levels.mode_shift else 1
    table = np.zeros((len(axes), points, order, order + 2))
    for i, axis in enumerate(axes):
        places = np.linspace(machine.limits.lower[i], machine.limits.upper[i], points) if points > 1 else machine.home[[i]]
        for k, place in enumerate(places if order else ()):
            stretch = 1.0 + levels.mode_shift * (place - machine.home[i]) / (machine.limits.upper[i] - machine.home[i])
            table[i, k] = mode_matrices(axis.modes, substep, order, stretch)
    return table


def _rest(mechanism, p, w, home, belts):
    n, m = home.size, w.q.size
    q = np.zeros(m)
    q[:n] = home - p.encoder_offset
    for _ in range(3):  # the belts bend under the weight they guide; far stiffer than it, so this settles at once
        rigid_terms(mechanism, q, np.zeros(m), p.rigid, w.M, w.C, w.G)
        if m > n:
            q[n:] -= (w.C[n:] + w.G[n:]) / belts.stiffness
    sticks = p.breakaway * p.coulomb
    held = np.clip(-w.G[:n], -sticks, sticks)
    return State(
        q=q,
        qd=np.zeros(m),
        qdd=np.zeros(m),
        modes=np.zeros((n, p.mode_table.shape[2])),
        joints=np.array([q[:n], np.zeros(n)]),
        bristle=held / p.bristle_stiffness,
        command=np.zeros(n),
        demand=np.zeros(n),
        current=np.zeros(n),
        short_force=np.zeros(n),
        emf_loop=np.zeros(n),
        heat=np.zeros(n),
        thrust=np.zeros(n),
        friction=held,
        counts=np.floor(home / p.resolution + 0.5).astype(np.int64),
    )
