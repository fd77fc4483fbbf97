"""Stability margins of one axis, (7.26)-(7.28), from the discrete open loop L = PID FL FN z^-1 ZOH{P}."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Margins:
    """What a loop tolerates; where `slowest_pole` is not below 1 it is unstable and the others mean nothing."""

    gain_margin: float  # [dB] allowed rise of the gain
    phase_margin: float  # [deg]
    peak_sensitivity: float  # max |1/(1 + L)|
    crossover: float  # [Hz] highest frequency with |L| = 1
    slowest_pole: float  # largest |z| of the closed loop


def plant_system(model, sample_time):
    """Return the python-control system z^-1 ZOH{P}: voltage [V] to position [m], one whole sample of computation."""
    import control  # takes a second to import; only design work needs it

    w = 2 * np.pi * model.current_loop
    plant = control.ss([[0, 1], [0, -model.viscosity]], [[0], [model.gain]], [[1, 0]], 0) * control.ss(-w, w, 1, 0)
    for mode in model.modes:
        plant = plant * _mode_section(control, mode)
    return control.sample_system(plant, sample_time, 'zoh') * control.ss(0, 1, 1, 0, sample_time)


def _mode_section(control, mode):
    """Return (wr^2/wa^2)(s^2 + 2 za wa s + wa^2)/(s^2 + 2 zr wr s + wr^2) with states scaled by wr."""
    wr, ratio = 2 * np.pi * mode.resonance, mode.antiresonance / mode.resonance
    damping = 2 * mode.resonance_damping
    output = np.array([[ratio**2 - 1, 2 * mode.antiresonance_damping * ratio - damping]]) / ratio**2
    return control.ss([[0, wr], [-wr, -damping * wr]], [[0], [wr]], output, 1 / ratio**2)


def open_loop(gains, model, sample_time):
    """Return L as a python-control system, error [m] to position [m]."""
    import control

    tau = gains.derivative_filter
    loop = plant_system(model, sample_time) * (
        gains.kp
        + control.ss(1, 1, gains.ki * sample_time, gains.ki * sample_time, sample_time)
        + control.tf2ss([gains.kd, -gains.kd], [sample_time + tau, -tau], sample_time)
    )
    for stage in (gains.lag, gains.notch):
        b0, b1, b2, a1, a2 = stage.discrete(sample_time)
        loop = loop * control.ss([[-a1, -a2], [1, 0]], [[1], [0]], [[b1 - a1 * b0, b2 - a2 * b0]], b0, sample_time)
    return loop


def stability_margins(gains, model, sample_time):
    """Return the `Margins` of one axis."""
    import control

    loop = open_loop(gains, model, sample_time)
    frequency = np.arange(1.0, 0.5 / sample_time, 0.25)  # Hz; the sharpest mode is 9 Hz wide
    z = np.exp(2j * np.pi * frequency * sample_time)
    response = control.frd(loop(z), 2 * np.pi * frequency, smooth=True)
    gain, phase, distance, _, crossover, _ = control.stability_margins(response, returnall=True)
    return Margins(
        gain_margin=float(20 * np.log10(min(gain[gain > 1], default=np.inf))),
        phase_margin=float(min(phase, key=abs)),
        peak_sensitivity=float(1 / distance.min()),
        crossover=float(crossover.max() / (2 * np.pi)),
        slowest_pole=float(np.abs(control.feedback(loop, 1).poles()).max()),
    )
