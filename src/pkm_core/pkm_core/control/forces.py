"""
Feedforward of the identified forces on a slider: friction, ripple, cogging and coupling.

With own = (qdd + a qd)/K the voltage that moves the slider along its reference is

    T = own + coulomb z + coupling c,   u = (T - cogging)/(1 + ripple)

z is the state of friction along the reference, c the coupling of the nominal design (`coupling_voltage`). The voltage
u has to arrive at the slider: it is divided by the response from the feedforward to the force and to the encoder, lag,
notch, computation, hold, current loop and modes included. That is done on a Fourier series, so that delays and zeros in
the right half plane are inverted exactly. Above `Band` of the lowest mode the feedforward is (7.24) alone.

The friction of a cycle begins where the previous cycle has left it; after power-up and a safe stop it begins at rest.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from pkm_core.control.margins import unit_circle
from pkm_core.control.systems import plant_system

# of the lowest mode: up to the first value the series is used, above the second one (7.24); 140 to 200 Hz with 233 Hz
BAND = (0.6, 0.86)
_RIGID = 233.0  # [Hz] taken as the lowest mode of a model without modes
_PAD = 512  # [samples] on each side: 256 ms, longer than the response of the inverse


@njit(cache=True)
def friction_course(position, start, length):
    """
    Return the friction z (N,) of a guide along `position` (N,) [m], from -1 to 1 in the direction of motion.

    dz = (sgn(dx) - z) |dx|/`length`, with z = `start` at the first sample; model of Dahl.
    """
    z, course = start, np.empty(position.size)
    for k in range(position.size):
        step = position[k] - position[k - 1] if k else 0.0
        if step > 0.0:
            z = 1.0 + (z - 1.0) * math.exp(-step / length)
        elif step < 0.0:
            z = -1.0 + (z + 1.0) * math.exp(step / length)
        course[k] = z
    return course


def coupling_voltage(machine, trajectory, column):
    """
    Return the design's coupling (N,) [V] on the joint in `column` of a trajectory in joints.

    It is (M qdd + C + G)_i - M_ii(home) qdd_i over the thrust per volt, with G relative to home.
    """
    position, velocity, acceleration, _ = trajectory.derivatives()
    force = machine.inverse_dynamics(position, velocity, acceleration)[:, column]
    own = machine.mass_matrix(machine.home)[column, column] * acceleration[:, column]
    return (force - own - machine.gravity(machine.home)[column]) / machine.thrust_per_volt


@dataclass(frozen=True)
class CycleForces:
    """One axis along one cycle, for `feedforward`."""

    position: np.ndarray  # (N,) [m] reference
    velocity: np.ndarray  # (N,) [m/s]
    acceleration: np.ndarray  # (N,) [m/s^2]
    coupling: np.ndarray  # (N,) [V], of `coupling_voltage`
    start: float  # friction z at the first sample

    def friction(self, model):
        """Return the friction z (N,) of the cycle with the `forces` of an `AxisModel`."""
        return friction_course(self.position, self.start, model.forces.slip)

    def voltage(self, model):
        """Return u (N,) [V] of this module at the slider."""
        forces = model.forces
        angle = 2 * np.pi * self.position / forces.pitch
        ripple = forces.ripple_sine * np.sin(angle) + forces.ripple_cosine * np.cos(angle)
        cogging = forces.cogging_sine * np.sin(2 * angle) + forces.cogging_cosine * np.cos(2 * angle)
        own = (self.acceleration + model.viscosity * self.velocity) / model.gain
        total = own + forces.coulomb * self.friction(model) + forces.coupling * self.coupling
        return (total - cogging) / (1 + ripple)


def feedforward(cycle, plain, gains, model, sample_time):
    """
    Return the feedforward (N + 1,) [V] that is added to `plain`, its last value that after the cycle.

    Parameters
    ----------
    cycle : CycleForces
        The cycle.
    plain : ndarray, shape (N,)
        Feedforward by (7.24) [V].
    gains : RobustGains
        Of the axis; its filters are inverted.
    model : AxisModel
        Of the axis, with `forces`.
    sample_time : float
        [s]

    """
    samples = len(plain)
    spectra = [np.fft.rfft(_extended(rows)) for rows in (cycle.voltage(model), plain)]
    frequency = np.fft.rfftfreq(samples + 4 * _PAD, sample_time)
    lowest = min((mode.resonance for mode in model.modes), default=_RIGID)
    fall = np.clip((frequency / lowest - BAND[0]) / (BAND[1] - BAND[0]), 0, 1)
    weight = 0.5 * (1 + np.cos(np.pi * fall))
    used = weight > 0
    difference = np.zeros(frequency.shape, dtype=complex)
    arrival = _arrival(gains, model, frequency[used], sample_time)
    difference[used] = weight[used] * (spectra[0][used] / arrival - spectra[1][used])
    return np.fft.irfft(difference, samples + 4 * _PAD)[_PAD : _PAD + samples + 1]


def _arrival(gains, model, frequency, sample_time):
    """Return the voltage at the slider, seen by the encoder, over the feedforward at `frequency` (F,) [Hz] from 0."""
    found = np.full(frequency.shape, gains.dc_gain, dtype=complex)  # at 0 Hz
    f = frequency[1:]
    z, s = unit_circle(f, sample_time), 2j * np.pi * f
    filters = gains.response(z, sample_time) / gains.pid_response(z, sample_time)
    found[1:] = filters * plant_system(model, sample_time)(z) * s * (s + model.viscosity) / model.gain
    return found


def _extended(rows):
    """Return `rows` (N,) with their first and last value held for _PAD samples each, and a blend from last to first."""
    blend = 0.5 * (1 - np.cos(np.pi * np.arange(2 * _PAD) / (2 * _PAD)))
    first, last = rows[0], rows[-1]
    return np.concatenate([np.full(_PAD, first), rows, np.full(_PAD, last), last + (first - last) * blend])
