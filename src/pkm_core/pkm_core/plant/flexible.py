"""
Modes that react on the machine: masses on springs, carried by the link pairs; coordinates eta beside the joints q.

A link pair joins two sliders of one guide. The mass mu of a mode moves with the velocity J(q) qd of the pair plus the
rate of its deflection eta. J is the gradient of a function of the joints: the owner's position, the position of the
pair's joint along the guide, or its height Y over the guide (`across`), in the shares that flexible_design.py sets.

    M qdd + SUM mu J' eta'' + C + G = F
    mu (eta'' + J qdd + Jdot qd) + c eta' + k eta = 0

The mass of the machine M is the identified total mass and includes mu. As J is a gradient, the coupling adds no
velocity-dependent force on q. Energy, 1/2 qd' M qd + SUM (mu J qd eta' + 1/2 mu eta'^2 + 1/2 k eta^2) and that of
gravity, is constant without forces and damping.

The scale of joint i reads q_i + u qd_i + SUM (w eta + v eta'). The shares w, v are those of the shape of the mode at
the scale; v is the phase of a complex mode, without which anti-resonances cannot have the dampings of H_i, and u, some
microseconds, is the slope of the phase of H_i at low frequency.
"""

import math

import numpy as np
from numba import njit

from pkm_core.plant.arrays import BEND_PARAMETERS


def no_bends(n):
    """Return (parameters, scales) without a mode, for `n` joints."""
    return np.zeros(0, BEND_PARAMETERS), np.zeros((2, n, 1))


@njit(cache=True, error_model='numpy')
def direction(mode, q, qd, row):
    """Fill `row` with J (n,) of a mode at `q` and return Jdot qd [m/s^2]."""
    for j in range(row.shape[0]):
        row[j] = 0.0
    owner, lower, higher = int(mode.owner), int(mode.lower), int(mode.higher)
    half, rate = 0.5 * (q[higher] - q[lower]), 0.5 * (qd[higher] - qd[lower])
    height = math.sqrt(mode.link * mode.link - half * half)
    slope = 0.5 * half / height  # dY/d(lower) = -dY/d(higher)
    rise = -half * rate / height
    row[owner] += mode.own
    row[lower] += mode.along + mode.across * slope
    row[higher] += mode.along - mode.across * slope
    return -mode.across * (rate * rate + rise * rise) / height


@njit(cache=True, error_model='numpy')
def bend_forces(bends, parameters, q, qd, h, M, force, work):
    """Take the modes into M (lower half) and `force` of the joints; `work` keeps the equation of each mode."""
    n = work.shape[1] - 1
    for m in range(bends.shape[0]):
        mode = parameters[m]
        bias = direction(mode, q, qd, work[m, :n])
        for j in range(n):
            work[m, j] *= mode.mass
        work[m, n] = -mode.mass * bias - mode.damping * bends[m, 1]
        work[m, n] -= mode.stiffness * (bends[m, 0] + 0.5 * h * bends[m, 1])
        inertia = mode.mass + 0.5 * h * mode.damping
        for i in range(n):
            share = work[m, i] / inertia
            force[i] -= share * work[m, n]
            for j in range(i + 1):
                M[i, j] -= share * work[m, j]


@njit(cache=True, error_model='numpy')
def bend(bends, parameters, acceleration, h, work):
    """Advance the modes by a substep `h` with the `acceleration` (n,) of the joints, after `bend_forces`."""
    n = work.shape[1] - 1
    for m in range(bends.shape[0]):
        left = work[m, n]
        for j in range(n):
            left -= work[m, j] * acceleration[j]
        bends[m, 2] = left / (parameters[m].mass + 0.5 * h * parameters[m].damping)
        bends[m, 0] += h * (bends[m, 1] + 0.5 * h * bends[m, 2])
        bends[m, 1] += h * bends[m, 2]
