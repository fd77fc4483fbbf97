"""
Drive of one axis: DAC, current loop, i2t limit, thrust with ripple and cogging, back EMF, commutation; thesis ch. 6.

The state of the current is its amplitude [A] in the frame of the magnets. With two-phase commutation the phase currents
of `phase_currents` give a thrust independent of position; their lag when turning at v / pitch (< 3 mrad at 0.5 m/s)
costs 4e-6 of the thrust.

Not modelled: the phase shift between the two references of the commutation, and the 150 V bus (Table 6.2). A step from
zero to the peak current requires 180 V for 4 us; a step over the whole range would take 12 us longer than modelled;
the steps of a smooth motion require a few volts.
"""

import math

import numpy as np
from numba import njit

_CAPACITOR = 22e-9  # F, of the analogue PI controller, thesis section 6.3


@njit(cache=True, error_model='numpy')
def dac_output(volts, voltage_limit, step):
    """Return the output [V] of a converter with codes of `step` for `volts`, saturated at +-`voltage_limit`."""
    within = min(max(volts, -voltage_limit), voltage_limit - step)
    return step * math.floor(within / step + 0.5)


@njit(cache=True, error_model='numpy')
def limited_current(command, heat, continuous, peak):
    """
    Return the amplitude [A] the amplifier follows: `command` limited to the peak, or to the continuous limit when hot.

    The i2t rule: `heat` is the filtered square of the rms current [A^2]; `continuous` is rms, `peak` an amplitude [A].
    """
    limit = peak if heat < continuous * continuous else min(peak, math.sqrt(2.0) * continuous)
    return min(max(command, -limit), limit)


@njit(cache=True, error_model='numpy')
def current_step(current, command, decay, time_constant, duration):
    """
    Return (amplitude, its integral [A s]) after the first-order current loop (6.3) followed a constant `command`.

    Exact; `decay` is exp(-duration / time_constant). The integral keeps the impulse of the thrust exact at any substep.
    """
    reached = command + (current - command) * decay
    return reached, command * duration - time_constant * (reached - current)


@njit(cache=True, error_model='numpy')
def motor_thrust(current, position, newton_per_ampere, ripple, cogging, pitch):
    """
    Return the thrust [N] at an amplitude `current` [A] with the carriage at `position` [m].

    `ripple` varies the force constant once per pitch; `cogging` [N] acts without current, twice per pitch.
    """
    angle = 2.0 * math.pi * position / pitch
    sine = math.sin(angle)
    return newton_per_ampere * current * (1.0 + ripple * sine) + cogging * 2.0 * sine * math.cos(angle)


@njit(cache=True, error_model='numpy')
def emf_step(short_force, loop_force, speed, damping, winding, winding_decay, loop, loop_decay, duration, shorted):
    """
    Return (short_force, loop_force, mean force [N]) of the back EMF after `duration` at constant `speed`.

    With the phases shorted the EMF drives a current through the winding: a force -damping v behind the lag L/R. Under
    current control the loop rejects it; from (6.1), (6.2) with unit feedback I/E = -s tau / (R (1 + s L/R)(1 + s tau)):
    the same force through a high-pass at the bandwidth of the loop. On the carriage this acts as a mass damping * tau,
    2 g. `winding` and `loop` are the time constants L/R and tau [s], the decays exp(-duration / time constant).
    """
    drag = damping * speed
    start = short_force - loop_force if shorted else short_force  # the current is continuous when phases are shorted
    end = drag + (start - drag) * winding_decay
    if shorted:
        return end, 0.0, winding * (end - start) / duration - drag
    slope = (end - start) / duration  # the input of the loop is approximated by a ramp
    loop_end = end - slope * loop + (loop_force - start + slope * loop) * loop_decay
    return end, loop_end, -loop * (loop_end - loop_force) / duration


def shorted_damping(thrust_per_ampere, resistance):
    """
    Return the braking force over speed [N s/m] of shorted phases, from the power of three star-connected phases.

    `thrust_per_ampere` is N per A of amplitude, `resistance` phase to phase [ohm]. With the rms force constant
    Kf = sqrt 2 thrust_per_ampere the phase EMF is Kf v / 3, so F v = 3 (Kf v / 3)^2 / (resistance / 2).
    """
    return 2.0 * (math.sqrt(2.0) * thrust_per_ampere) ** 2 / (3.0 * resistance)


def phase_currents(current, position, pitch):
    """
    Return the three phase currents (3, ...) [A] of an amplitude `current` [A] with the carriage at `position` [m].

    Ua = U cos(the + th0), Ub = U cos(the + th0 + 2 pi/3), Ic = -(Ia + Ib), the = 2 pi position / pitch (6.2);
    th0 = pi/2 puts the current in phase with the EMF.
    """
    angle = 2.0 * np.pi * np.asarray(position) / pitch + np.pi / 2.0
    a = current * np.cos(angle)
    b = current * np.cos(angle + 2.0 * np.pi / 3.0)
    return np.array([a, b, -(a + b)])


def current_loop_response(frequencies, drive):
    """
    Return the complex response, current over command, of the current loop: 1 at low frequency; (6.1)-(6.3), Fig. 6.10.

    The components follow from pole placement: R = Lm / (Rm C) (6.2), Rc from the bandwidth. The lag alone gives
    -7.68 deg at 1 kHz; the thesis measured -8.72 deg. The difference is drive.delay.

    Parameters
    ----------
    frequencies : array_like
        [Hz].
    drive : truth.Drive
        Winding, bandwidth, delay.

    """
    s = 2j * np.pi * np.asarray(frequencies, dtype=float)
    R = drive.inductance / (drive.resistance * _CAPACITOR)
    Rc = 1.0 / (2.0 * np.pi * drive.bandwidth * drive.resistance * _CAPACITOR)
    lead = 1.0 + s * R * _CAPACITOR
    motor = drive.resistance + s * drive.inductance
    return lead / (motor * s * Rc * _CAPACITOR + lead) * np.exp(-s * drive.delay)
