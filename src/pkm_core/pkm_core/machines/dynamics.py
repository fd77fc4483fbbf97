"""
Rigid-body dynamics M(q) qdd + C(q, qd) + G(q) = F of the machines, compiled; SI, F > 0 acts on a slider towards +d.

One kernel per mechanism, all with the signature ``terms(q, qd, p, M, C, G)``: it overwrites the preallocated M (n, n)
[kg] and C, G (n,) [N]. The parameter vector p (float64) has the entries named in NAME_PARAMETERS, in that order.
Links are rigid, belts ideal, joints frictionless; elasticity and friction are in the plant. Gravity acts along -z.
Source: thesis ch. 5 and 7, written as a sum over bodies of J' m J and J' m (Jdot qd). These are the same equations
without the printing errors of M_p, M_v and G_v.
"""

import math

from numba import njit

GRAVITY = 9.81  # m/s^2, as in the thesis's ch. 5

PLANAR_PARAMETERS = ('l2', 'm1', 'm2', 'm3', 'm4', 'mp', 'r2', 'r4', 'I2', 'I4')
XY_STAGE_PARAMETERS = ('mx', 'my')  # mass moved along X (the Y axis included), mass moved along Y [kg]
FOUR_DOF_PARAMETERS = (
    *('l2', 'k10', 'dx', 'dy'),  # links 2, 4, 6, 8; links 10, 12; offsets of Q and P (2.6), (2.7) [m]
    *('m1', 'm2', 'm3', 'm4', 'm5', 'm6', 'm7', 'm8', 'mp', 'mq', 'm9', 'm10', 'm11', 'm12', 'mef'),  # [kg]
    *('r2', 'r4', 'r6', 'r8', 'r10', 'r12'),  # centre of mass from the slider pivot; of 10, 12 from the lower pivot [m]
    *('I2', 'I4', 'I6', 'I8', 'I9', 'I10', 'I11', 'I12', 'Ief'),  # about the centre of mass [kg m^2]
    'slender',  # links 10, 12 about the vertical: 0 constant I (thesis), 1 thin rods I cos^2 of their elevation
)


@njit(cache=True, error_model='numpy')
def _t_mechanism(l2, h, hd, sliders, links, arms, inertias):
    """
    Return one pair of sliders with its two links: (Mll, Mlh, Mhh, f, c, Y, yb).

    `h` is half the gap between the lower and the higher slider, `hd` its rate; pairs are (lower, higher).
    M are the pair's mass terms, -f and +f its bias forces, Y the height of the joint over the guide,
    c = dY/d(lower) = -dY/d(higher), yb the velocity-dependent part of the acceleration of Y.
    """
    A = links[0] * arms[0] ** 2 + inertias[0] + links[1] * arms[1] ** 2 + inertias[1]
    YY = l2 * l2 - h * h
    Y = math.sqrt(YY)
    a = A / (4.0 * YY)
    b0 = links[0] * arms[0] / l2
    b1 = links[1] * arms[1] / l2
    Yd = -h * hd / Y
    return (
        sliders[0] + links[0] - b0 + a,
        0.5 * (b0 + b1) - a,
        sliders[1] + links[1] - b1 + a,
        A * h * hd * hd / (2.0 * YY * YY),
        0.5 * h / Y,
        Y,
        -(hd * hd + Yd * Yd) / Y,
    )


@njit(cache=True, error_model='numpy')
def planar_terms(q, qd, p, M, C, G):
    """Fill M, C, G of the planar manipulator, q = [d1, d3]; p as PLANAR_PARAMETERS; (7.1)-(7.12)."""
    l2, m1, m2, m3, m4, mp, r2, r4, I2, I4 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9]
    Mll, Mlh, Mhh, f, c, _, yb = _t_mechanism(
        l2, 0.5 * (q[1] - q[0]), 0.5 * (qd[1] - qd[0]), (m1, m3), (m2, m4), (r2, r4), (I2, I4)
    )
    M[0, 0] = Mll + mp * (0.25 + c * c)
    M[1, 1] = Mhh + mp * (0.25 + c * c)
    M[0, 1] = M[1, 0] = Mlh + mp * (0.25 - c * c)
    C[0] = mp * c * yb - f
    C[1] = -C[0]
    G[0] = G[1] = 0.0


@njit(cache=True, error_model='numpy')
def xy_stage_terms(q, qd, p, M, C, G):
    """Fill M, C, G of the stacked XY stage, q = [x, y]; p as XY_STAGE_PARAMETERS."""
    M[0, 0] = p[0]
    M[1, 1] = p[1]
    M[0, 1] = M[1, 0] = 0.0
    C[0] = C[1] = 0.0
    G[0] = G[1] = 0.0


@njit(cache=True, error_model='numpy')
def four_dof_terms(q, qd, p, M, C, G):
    """Fill M, C, G of the 4-DOF manipulator, q = [d1, d3, d5, d7]; p as FOUR_DOF_PARAMETERS; (5.1)-(5.21)."""
    l2, k10, dx, dy = p[0], p[1], p[2], p[3]
    m1, m2, m3, m4, m5, m6, m7, m8 = p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11]
    mp, mq, m9, m10, m11, m12, mef = p[12], p[13], p[14], p[15], p[16], p[17], p[18]
    r2, r4, r6, r8, r10, r12 = p[19], p[20], p[21], p[22], p[23], p[24]
    I2, I4, I6, I8, I9, I10, I11, I12, Ief = p[25], p[26], p[27], p[28], p[29], p[30], p[31], p[32], p[33]
    slender = p[34]

    # the two slider pairs; (ud1, ud2) and (ud3, ud4) are the velocities of P and Q
    h1, hd1 = 0.5 * (q[1] - q[0]), 0.5 * (qd[1] - qd[0])
    h2, hd2 = 0.5 * (q[2] - q[3]), 0.5 * (qd[2] - qd[3])
    M11, M13, M33, f1, c1, Y1, y1b = _t_mechanism(l2, h1, hd1, (m1, m3), (m2, m4), (r2, r4), (I2, I4))
    M77, M57, M55, f2, c2, X2, x2b = _t_mechanism(l2, h2, hd2, (m7, m5), (m8, m6), (r8, r6), (I8, I6))
    ud1, ud2 = 0.5 * (qd[0] + qd[1]), -2.0 * c1 * hd1
    ud3, ud4 = -2.0 * c2 * hd2, 0.5 * (qd[2] + qd[3])

    # the vertical T-mechanism on w = PQ: R is half its length, Z the height of the joint over P and Q
    wx, wy = X2 + dx - 0.5 * (q[0] + q[1]), 0.5 * (q[2] + q[3]) - Y1 - dy
    wdx, wdy = ud3 - ud1, ud4 - ud2
    RR = 0.25 * (wx * wx + wy * wy)
    RRd = 0.5 * (wx * wdx + wy * wdy)
    Z = math.sqrt(k10 * k10 - RR)
    zd = -0.5 * RRd / Z
    phid = (wx * wdy - wy * wdx) / (4.0 * RR)
    zb = -(zd * zd + 0.25 * (wdx * wdx + wdy * wdy + wx * x2b - wy * y1b)) / Z
    phib = -(wx * y1b + wy * x2b) / (4.0 * RR) - phid * RRd / RR

    # rows z and phi of the Jacobian (3.7)-(3.14)
    s, t = 0.25 / Z, 0.25 / RR
    jz = (
        s * (0.5 * wx + c1 * wy),
        s * (0.5 * wx - c1 * wy),
        s * (c2 * wx - 0.5 * wy),
        s * (-c2 * wx - 0.5 * wy),
    )
    jphi = (
        t * (0.5 * wy - c1 * wx),
        t * (0.5 * wy + c1 * wx),
        t * (c2 * wy + 0.5 * wx),
        t * (-c2 * wy + 0.5 * wx),
    )

    # effective masses at P, at Q and between them; mz in z; inertias in elevation and about the vertical
    ra, rb = r10 / k10, r12 / k10
    mPP = mp + m9 + m10 * (1.0 - 0.5 * ra) ** 2 + m12 * (0.5 * rb) ** 2 + 0.25 * mef
    mQQ = mq + m11 + m10 * (0.5 * ra) ** 2 + m12 * (1.0 - 0.5 * rb) ** 2 + 0.25 * mef
    mPQ = m10 * (1.0 - 0.5 * ra) * 0.5 * ra + m12 * 0.5 * rb * (1.0 - 0.5 * rb) + 0.25 * mef
    mz = m10 * ra * ra + m12 * rb * rb + mef
    I_rods = I10 + I12
    dIz = slender * I_rods / (k10 * k10)  # of Iz with RR: cos^2 of the elevation is RR / k10^2
    Iz = I9 + I11 + Ief + (1.0 - slender) * I_rods + dIz * RR

    fz = mz * zb + I_rods * (zb - 0.5 * zd * RRd / RR) / RR + dIz * Z * phid * phid
    fphi = Iz * phib + dIz * RRd * phid
    weight = GRAVITY * (m10 * ra + m12 * rb + mef)

    M[0, 0] = M11 + mPP * (0.25 + c1 * c1)
    M[1, 0] = M13 + mPP * (0.25 - c1 * c1)
    M[1, 1] = M33 + mPP * (0.25 + c1 * c1)
    M[2, 0] = 0.5 * mPQ * (c1 - c2)
    M[2, 1] = -0.5 * mPQ * (c1 + c2)
    M[2, 2] = M55 + mQQ * (0.25 + c2 * c2)
    M[3, 0] = 0.5 * mPQ * (c1 + c2)
    M[3, 1] = 0.5 * mPQ * (c2 - c1)
    M[3, 2] = M57 + mQQ * (0.25 - c2 * c2)
    M[3, 3] = M77 + mQQ * (0.25 + c2 * c2)
    C[0] = 0.5 * mPQ * x2b + c1 * mPP * y1b - f1
    C[1] = 0.5 * mPQ * x2b - c1 * mPP * y1b + f1
    C[2] = 0.5 * mPQ * y1b - c2 * mQQ * x2b + f2
    C[3] = 0.5 * mPQ * y1b + c2 * mQQ * x2b - f2
    kz = mz + I_rods / RR
    for i in range(4):
        C[i] += jz[i] * fz + jphi[i] * fphi
        G[i] = jz[i] * weight
        for j in range(i + 1):
            M[i, j] += kz * jz[i] * jz[j] + Iz * jphi[i] * jphi[j]
            M[j, i] = M[i, j]


# The kernels over histories q, qd (T, n) into M (T, n, n), C, G (T, n). Three loops instead of one: numba 0.68 cannot
# cache a loop that takes its kernel as an argument, and a cached guvectorize crashes.


@njit(cache=True, error_model='numpy')
def planar_rows(q, qd, p, M, C, G):
    """Call `planar_terms` for every row."""
    for i in range(q.shape[0]):
        planar_terms(q[i], qd[i], p, M[i], C[i], G[i])


@njit(cache=True, error_model='numpy')
def xy_stage_rows(q, qd, p, M, C, G):
    """Call `xy_stage_terms` for every row."""
    for i in range(q.shape[0]):
        xy_stage_terms(q[i], qd[i], p, M[i], C[i], G[i])


@njit(cache=True, error_model='numpy')
def four_dof_rows(q, qd, p, M, C, G):
    """Call `four_dof_terms` for every row."""
    for i in range(q.shape[0]):
        four_dof_terms(q[i], qd[i], p, M[i], C[i], G[i])
