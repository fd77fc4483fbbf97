"""
Sine forces without control, (5.22)-(5.25): response by the equations of motion and of the simulated machine.

F1 = F5 = a sin(w t), F3 = F7 = a sin(w t - lag) for two periods, from rest at home. A sine force from rest causes an
oscillation and a drift. F > 0 acts along +d on every slider. The thesis has the opposite sign in the rows of d3 and d5
of M_p, and its initial positions are illegible; its figures can only be compared qualitatively.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from pkm_core.design.specimen import end_point
from pkm_core.errors import PkmError
from pkm_core.plant.belts import four_dof_belt_terms
from pkm_core.plant.plant import Plant

AMPLITUDE = 10.5  # [N] (5.22): the thrust at about 1 V
PERIODS = 2
REST = 0.1  # [s] without force, in which belts come to rest
BELT_DAMPING = 0.03  # [of critical] with the carriages held; chosen
_SAMPLES = 281  # of the integrated models, about one per tick


@dataclass(frozen=True)
class ForceCase:
    """One of the four cases (5.24), (5.25)."""

    title: str
    rate: float  # w [rad/s]
    lag: float  # of F3, F7 [rad]

    @property
    def duration(self):
        """Duration of the forces [s]."""
        return PERIODS * 2.0 * np.pi / self.rate

    def force(self, time):
        """Return the forces (..., 4) [N] on d1, d3, d5, d7 at `time` (...,) [s]; zero after `duration`."""
        time = np.asarray(time)[..., np.newaxis]
        sine = AMPLITUDE * np.sin(self.rate * time - self.lag * np.array([0.0, 1.0, 0.0, 1.0]))
        return np.where(time <= self.duration, sine, 0.0)


CASES = {
    'i_a': ForceCase('(i)(a)', 89.8, np.radians(30.0)),
    'i_b': ForceCase('(i)(b)', 89.8, np.radians(330.0)),
    'ii_a': ForceCase('(ii)(a)', 125.7, np.radians(150.0)),
    'ii_b': ForceCase('(ii)(b)', 125.7, np.radians(210.0)),
}


@dataclass(frozen=True)
class Response:
    """
    The response of one model to one case; one row per sample, the first at rest.

    Attributes
    ----------
    time : ndarray, shape (T,)
        Time [s].
    force, q : ndarray, shape (T, 4)
        Commanded forces [N]; true joint positions [m].
    pose : ndarray, shape (T, 4)
        End point x, y, z [m], phi [rad].
    belts, belt_shift : ndarray, shape (T, 2) and (T, 4), or None
        Rotations psi_p, psi_q of the platforms [rad] and the resulting shift of the end point [m, rad]; None with
        rigid belts.
    fault : str or None
        Fault of the machine; the integrated models have none.

    """

    time: np.ndarray
    force: np.ndarray
    q: np.ndarray
    pose: np.ndarray
    belts: np.ndarray | None = None
    belt_shift: np.ndarray | None = None
    fault: str | None = None


def integrate(machine, case, belt_stiffness=None):
    """
    Return the `Response` of the rigid machine without losses, M(q) qdd + C(q, qd) + G(q) = F; (5.1).

    Parameters
    ----------
    machine : FourDof
        Machine with its nominal design.
    case : ForceCase
        One of `CASES`.
    belt_stiffness : float, optional
        kb [N m/rad]; selects the full model of 5.5. The rotations of the platforms are two more coordinates with the
        damping `BELT_DAMPING`, and the response is longer by `REST`.

    Raises
    ------
    PkmError
        If the machine is not a 4-DOF manipulator.

    """
    if machine.config.mechanism != 'four_dof':
        raise PkmError(f'{machine.name}: a {machine.config.mechanism} given; expected a four_dof for (5.22)-(5.25)')
    terms, p, start = machine.terms, machine.dynamic_parameters(), machine.home
    duration, samples = case.duration, _SAMPLES
    if belt_stiffness is not None:
        terms = four_dof_belt_terms
        p, start = _with_belts(p, start, belt_stiffness)
        samples += round(REST / duration * _SAMPLES)
        duration += REST
    m = start.size
    M, C, G, force = np.empty((m, m)), np.empty(m), np.empty(m), np.zeros(m)

    def rate(time, state):
        force[:4] = case.force(time)
        terms(state[:m], state[m:], p, M, C, G)
        return np.append(state[m:], np.linalg.solve(M, force - C - G))

    time = np.linspace(0.0, duration, samples)
    # accuracy 1e-13 m; max_step keeps the integrator from stepping over the end of the forces
    solution = solve_ivp(
        rate, (0.0, duration), np.append(start, np.zeros(m)), 'DOP853', time, rtol=1e-10, atol=1e-13, max_step=1e-3
    )
    q, belts = solution.y[:4].T, solution.y[4:m].T
    pose = machine.forward(q)
    if belt_stiffness is None:
        return Response(time, case.force(time), q, pose)
    bent = end_point(machine, q, {'psi_p': belts[:, 0], 'psi_q': belts[:, 1]})
    return Response(time, case.force(time), q, bent, belts, bent - pose)


def _with_belts(p, home, stiffness):
    """Return the parameters of the full model, and its position at rest with the belts loaded by gravity."""
    p, q, still = np.append(p, [stiffness, 0.0]), np.append(home, [0.0, 0.0]), np.zeros(6)
    M, C, G = np.empty((6, 6)), np.empty(6), np.empty(6)
    for _ in range(3):  # Newton steps; the deflection by gravity is small
        four_dof_belt_terms(q, still, p, M, C, G)
        q[4:] -= (C[4:] + G[4:]) / stiffness
    p[-1] = 2.0 * BELT_DAMPING * np.sqrt(stiffness * M[4, 4])
    return p, q


def play(machine, case, seed, environment):
    """Return the `Response` of the complete simulated machine to the drive voltages of the forces of `case`."""
    plant = Plant(machine, seed, environment)
    ticks = round(case.duration / machine.sample_time)
    if plant.truth.belts.size:
        ticks += round(REST / machine.sample_time)
    time = machine.sample_time * np.arange(ticks + 1)
    force = case.force(time)
    truths = [plant.truth]
    for row in force[:-1]:
        plant.tick(row / machine.thrust_per_volt)
        truths.append(plant.truth)
    q, pose, belts = (np.array([getattr(truth, name) for truth in truths]) for name in ('q', 'pose', 'belts'))
    if not belts.size:
        return Response(time, force, q, pose, fault=plant.fault)
    stiff = truths[0].assembly.end_point(q, np.zeros_like(belts))
    return Response(time, force, q, pose, belts, pose - stiff, plant.fault)
