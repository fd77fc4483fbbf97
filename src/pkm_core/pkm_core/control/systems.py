"""
Linear models of one discrete loop as plain matrices; used by margins, tuning and the check of new gains.

`System.control` converts one for python-control, whose import takes seconds; no node needs that.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class System:
    """One input, one output: x+ = A x + B u (continuous: dx/dt = A x + B u), y = C x + D u."""

    A: np.ndarray  # (n, n)
    B: np.ndarray  # (n, 1)
    C: np.ndarray  # (1, n)
    D: float

    @classmethod
    def of(cls, A, B, C, D=0.0):
        """Return the system of nested lists."""
        A, B, C = (np.array(matrix, dtype=np.float64) for matrix in (A, B, C))
        return cls(A.reshape(B.size, B.size), B.reshape(-1, 1), C.reshape(1, -1), float(D))

    def then(self, other):
        """Return the series connection: the output of this one is the input of `other`."""
        A = np.block([[self.A, np.zeros((self.A.shape[0], other.A.shape[0]))], [other.B @ self.C, other.A]])
        return System(
            A, np.vstack([self.B, other.B * self.D]), np.hstack([other.D * self.C, other.C]), other.D * self.D
        )

    def sampled(self, sample_time):
        """Return this continuous system discretised with a zero-order hold; exact."""
        from scipy.linalg import expm

        n = self.B.size
        block = np.zeros((n + 1, n + 1))
        block[:n, :n], block[:n, n:] = self.A * sample_time, self.B * sample_time
        block = expm(block)
        return System(block[:n, :n], block[:n, n:], self.C, self.D)

    def __call__(self, z):
        """Return the transfer function at the complex points `z` (s if continuous), any shape."""
        from scipy.linalg import schur

        z = np.asarray(z, dtype=np.complex128)
        triangle, basis = schur(self.A, output='complex')
        entering, leaving = basis.conj().T @ self.B[:, 0], self.C[0] @ basis
        states = [0.0] * self.B.size
        for i in reversed(range(self.B.size)):  # (z - A) x = B from below, for all z at once
            above = sum(triangle[i, j] * states[j] for j in range(i + 1, self.B.size))
            states[i] = (entering[i] + above) / (z - triangle[i, i])
        return sum(c * x for c, x in zip(leaving, states, strict=True)) + self.D

    def closed_loop_poles(self):
        """Return the poles of L/(1 + L), this system being L."""
        return np.linalg.eigvals(self.A - self.B @ self.C / (1 + self.D))

    def control(self, sample_time):
        """Return the discrete system as a python-control object."""
        import control

        return control.ss(self.A, self.B, self.C, self.D, sample_time)


def plant_system(model, sample_time, *, stuck=False):
    """
    Return z^-1 ZOH{P}, voltage [V] to position [m] of an `AxisModel`; z^-1 is the computation delay.

    `stuck`: with a guide at rest, which is a spring; the model needs `forces`.
    """
    spring = model.gain * model.forces.coulomb / model.forces.slip if stuck else 0
    corner = 2 * np.pi * model.current_loop
    plant = System.of([[-corner]], [corner], [1])
    plant = plant.then(System.of([[0, 1], [-spring, -model.viscosity]], [0, model.gain], [1, 0]))
    for mode in model.modes:
        plant = plant.then(_mode_section(mode))
    return plant.sampled(sample_time).then(System.of([[0]], [1], [1]))


def open_loop(gains, model, sample_time):
    """Return L, law times z^-1 ZOH{P}, of an `AxisLaw` and an `AxisModel`, error [m] to position [m]."""
    return gains.system(sample_time).then(plant_system(model, sample_time))


def pid_system(gains, sample_time):
    """Return PID FL FN of a `PidLaw`, error [m] to voltage [V]."""
    control = _pid_system(gains, sample_time)
    for stage in gains.stages:
        b0, b1, b2, a1, a2 = stage.discrete(sample_time)
        control = control.then(System.of([[-a1, -a2], [1, 0]], [1, 0], [b1 - a1 * b0, b2 - a2 * b0], b0))
    return control


def _pid_system(gains, sample_time):
    """Return KP + KI Ts/(1 - 1/z) + KD (1 - 1/z)/(Ts + tau (1 - 1/z)); with KI = 0 there is no integral state."""
    carry = gains.derivative_filter / (gains.derivative_filter + sample_time)
    slope = gains.kd / (gains.derivative_filter + sample_time)
    if not gains.ki:
        return System.of([[carry]], [1], [slope * (carry - 1)], gains.kp + slope)
    step = gains.ki * sample_time
    return System.of([[carry, 0], [0, 1]], [1, 1], [slope * (carry - 1), step], gains.kp + slope + step)


def _mode_section(mode):
    """Return (wr^2/wa^2)(s^2 + 2 za wa s + wa^2)/(s^2 + 2 zr wr s + wr^2) with states scaled by wr."""
    wr, ratio = 2 * np.pi * mode.resonance, mode.antiresonance / mode.resonance
    damping = 2 * mode.resonance_damping
    output = np.array([ratio**2 - 1, 2 * mode.antiresonance_damping * ratio - damping]) / ratio**2
    return System.of([[0, wr], [-wr, -damping * wr]], [0, wr], output, 1 / ratio**2)
