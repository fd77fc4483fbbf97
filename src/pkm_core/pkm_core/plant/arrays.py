"""
Arrays of the compiled tick: all float64; a structured array has one field per quantity and one row per joint.

n joints, m >= n coordinates of the rigid machine: the joints [m], then the belt rotations [rad] if there are any.
"""

from dataclasses import dataclass

import numpy as np

MECHANISMS = ('planar', 'xy_stage', 'four_dof', 'four_dof_belts')  # by their index in tick.rigid_terms
REFUSED = -1  # event: a voltage is not finite; other events are 0 or 1 + the row of the contact that touched first
Q, QD, QDD = range(3)  # rows of the motion (3, m) of the rigid machine: joints [m], then belt rotations [rad]
ENCODER, AMPLIFIER, FLOOR = range(3)  # of the noise (3, ticks, n): counts, V, m/s^2


def _fields(**fields):
    """Return the structure with these float64 fields; the texts are documentation only."""
    return np.dtype([(name, np.float64) for name in fields])


# State, one row per joint.
AXIS_STATE = _fields(
    position='of the scale: rigid position plus deflections [m]',
    speed='of the scale [m/s]',
    bristle='deflection of the friction bristles [m]',
    command='computed, applied in the next tick [V]',
    before='amplitude commanded to the current loop in the previous tick [A]',
    demand='amplitude commanded to the current loop in this tick [A]',
    current='amplitude [A]',
    short_force='see drive.emf_step [N]',
    loop_force='see drive.emf_step [N]',
    heat='filtered square of the rms current [A^2]',
    square='squares of the amplitude, summed over ticks [A^2]',
    rubbing='power of friction, summed over ticks [W]',
    thrust='mean of the last substep [N]',
    friction='mean of the last substep, against the motion [N]',
)

# Constants, one row per joint; start_cycle draws newton_per_ampere and coulomb for each cycle.
AXIS_PARAMETERS = _fields(
    newton_per_ampere='of amplitude',
    coulomb='[N]',
    extra_mass='[kg]',
    viscous='[N s/m]',
    encoder_offset='[m]',
    lower='end of the travel [m]',
    upper='end of the travel [m]',
)

# Constants common to all joints, one row.
COMMON_PARAMETERS = _fields(
    substep='[s]',
    voltage_limit='[V]',
    dac_step='[V]',
    ampere_per_volt='amplitude',
    continuous_current='rms [A]',
    peak_current='amplitude [A]',
    heat_share='sample time over thermal time',
    current_lag='[s]',
    current_delay='[s]',
    decay_delay='exp(-duration / lag) of the current over the delay',
    decay_rest='over the rest of the first substep',
    decay='over any other substep',
    winding='L / R of the winding [s]',
    decay_winding='exp(-substep / winding)',
    emf_damping='force of shorted phases over speed, 0 without back EMF [N s/m]',
    brake_damping='the same for the brake [N s/m]',
    ripple='of the thrust',
    cogging='[N]',
    pitch='[m]',
    breakaway='static over Coulomb friction',
    stribeck_speed='[m/s]',
    bristle_stiffness='[N/m]',
    bristle_damping='[N s/m]',
    elastic='share of the breakaway deflection',
    contact_stiffness='[N/m]',
    contact_damping='[s/m]',
    resolution='[m/count]',
    signal_period='[m]',
    subdivision_error='[m]',
    encoder_latency='[s]',
)

# Constants of the modes that react on the machine, one row per mode; see flexible.py.
BEND_PARAMETERS = _fields(
    owner='joint whose H_i has this mode',
    lower='joint of its link pair',
    higher='joint of its link pair',
    link='length of the links of the pair [m]',
    own='share of the owner in the direction of the mode',
    along='share of each joint of the pair, along its guide',
    across='share of the height of the pair over its guide',
    mass='[kg]',
    stiffness='[N/m]',
    damping='[N s/m]',
)


@dataclass(frozen=True)
class PlantArrays:
    """The array arguments of tick.advance, in its order; the state comes first. f: modes that react."""

    motion: np.ndarray  # (3, m) rows Q, QD, QDD
    axes: np.ndarray  # (n,) AXIS_STATE
    modes: np.ndarray  # (n, k, 2) deflection [m] and rate [m/s] of each mode
    counts: np.ndarray  # (n,) int64
    mechanism: int  # index in MECHANISMS
    rigid: np.ndarray  # parameters of the dynamics kernel
    parameters: np.ndarray  # (n,) AXIS_PARAMETERS
    common: np.ndarray  # (1,) COMMON_PARAMETERS
    contacts: np.ndarray  # (c, 3) joint below, joint above (-1: the base), their distance at contact [m]
    mode_table: np.ndarray  # (n, points over the travel, k, modes.STEP_SIZE)
    scratch: np.ndarray  # (m + 5, m) working space
    steps: np.ndarray  # (n, k, modes.STEP_SIZE) at the present position
    bends: np.ndarray  # (f, 3) state: deflection [m], rate [m/s] and acceleration [m/s^2] of each mode that reacts
    bend_parameters: np.ndarray  # (f,) BEND_PARAMETERS
    scales: np.ndarray  # (2, n, f + 1) share of deflections and rates [s] in each scale; last: of the joint itself
    bend_scratch: np.ndarray  # (f, n + 1) direction times mass [kg], force [N]
