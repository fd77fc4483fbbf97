"""
Dynamics of the 4-DOF manipulator with elastic belts (thesis section 5.5): the platform rotations are coordinates too.

The belts hold the platforms under P and Q parallel to the base. When the belts stretch, the platform arms turn,
    P = (x1 - dy sin psi_p, Y1 + dy cos psi_p),   Q = (X2 + dx cos psi_q, y2 + dx sin psi_q),
against kb psi + cb psi'. As in the rigid model the mass of a platform is at P (Q); its inertia is unknown and left out.
"""

import math

from numba import njit

from pkm_core.machines.dynamics import GRAVITY, _t_mechanism


@njit(cache=True, error_model='numpy')
def four_dof_belt_terms(q, qd, p, M, C, G):
    """
    Fill M (6, 6), C, G (6,) for q = [d1, d3, d5, d7, psi_p, psi_q]: four_dof_terms with a wider Jacobian.

    `p` is that of dynamics.four_dof_terms followed by kb [N m/rad] and cb [N m s/rad]; C includes both belt torques.
    """
    l2, k10, dx, dy = p[0], p[1], p[2], p[3]
    m1, m2, m3, m4, m5, m6, m7, m8 = p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11]
    mp, mq, m9, m10, m11, m12, mef = p[12], p[13], p[14], p[15], p[16], p[17], p[18]
    r2, r4, r6, r8, r10, r12 = p[19], p[20], p[21], p[22], p[23], p[24]
    I2, I4, I6, I8, I9, I10, I11, I12, Ief = p[25], p[26], p[27], p[28], p[29], p[30], p[31], p[32], p[33]
    slender, kb, cb = p[34], p[35], p[36]

    h1, hd1 = 0.5 * (q[1] - q[0]), 0.5 * (qd[1] - qd[0])
    h2, hd2 = 0.5 * (q[2] - q[3]), 0.5 * (qd[2] - qd[3])
    M11, M13, M33, f1, c1, Y1, y1b = _t_mechanism(l2, h1, hd1, (m1, m3), (m2, m4), (r2, r4), (I2, I4))
    M77, M57, M55, f2, c2, X2, x2b = _t_mechanism(l2, h2, hd2, (m7, m5), (m8, m6), (r8, r6), (I8, I6))
    sp, cp, sq, cq = math.sin(q[4]), math.cos(q[4]), math.sin(q[5]), math.cos(q[5])
    # every coordinate moves one foot of the vertical T-mechanism, P (0) or Q (1), by (jx, jy)
    foot = (0, 0, 1, 1, 0, 1)
    jx = (0.5, 0.5, -c2, c2, -dy * cp, -dx * sq)
    jy = (c1, -c1, 0.5, 0.5, -dy * sp, dx * cq)
    # velocity-dependent parts of the accelerations of P and Q
    bPx, bPy = dy * sp * qd[4] ** 2, y1b - dy * cp * qd[4] ** 2
    bQx, bQy = x2b - dx * cq * qd[5] ** 2, -dx * sq * qd[5] ** 2
    wx = X2 + dx * cq - 0.5 * (q[0] + q[1]) + dy * sp
    wy = 0.5 * (q[2] + q[3]) + dx * sq - Y1 - dy * cp
    wdx = wdy = 0.0
    for i in range(6):
        sense = 2.0 * foot[i] - 1.0  # of w = Q - P
        wdx += sense * jx[i] * qd[i]
        wdy += sense * jy[i] * qd[i]
    wbx, wby = bQx - bPx, bQy - bPy

    # the vertical T-mechanism on w = PQ, as in four_dof_terms
    RR = 0.25 * (wx * wx + wy * wy)
    RRd = 0.5 * (wx * wdx + wy * wdy)
    Z = math.sqrt(k10 * k10 - RR)
    zd = -0.5 * RRd / Z
    phid = (wx * wdy - wy * wdx) / (4.0 * RR)
    zb = -(zd * zd + 0.25 * (wdx * wdx + wdy * wdy + wx * wbx + wy * wby)) / Z
    phib = (wx * wby - wy * wbx) / (4.0 * RR) - phid * RRd / RR
    s, t = 0.25 / Z, 0.25 / RR

    ra, rb = r10 / k10, r12 / k10
    mPP = mp + m9 + m10 * (1.0 - 0.5 * ra) ** 2 + m12 * (0.5 * rb) ** 2 + 0.25 * mef
    mQQ = mq + m11 + m10 * (0.5 * ra) ** 2 + m12 * (1.0 - 0.5 * rb) ** 2 + 0.25 * mef
    mPQ = m10 * (1.0 - 0.5 * ra) * 0.5 * ra + m12 * 0.5 * rb * (1.0 - 0.5 * rb) + 0.25 * mef
    mz = m10 * ra * ra + m12 * rb * rb + mef
    I_rods = I10 + I12
    dIz = slender * I_rods / (k10 * k10)
    Iz = I9 + I11 + Ief + (1.0 - slender) * I_rods + dIz * RR
    fz = mz * zb + I_rods * (zb - 0.5 * zd * RRd / RR) / RR + dIz * Z * phid * phid
    fphi = Iz * phib + dIz * RRd * phid
    kz = mz + I_rods / RR
    weight = GRAVITY * (m10 * ra + m12 * rb + mef)

    masses = ((mPP, mPQ), (mPQ, mQQ))
    bias_x = (mPP * bPx + mPQ * bQx, mPQ * bPx + mQQ * bQx)
    bias_y = (mPP * bPy + mPQ * bQy, mPQ * bPy + mQQ * bQy)
    for i in range(6):
        sense = 1.0 - 2.0 * foot[i]  # of z and phi, which increase as P moves towards Q and about it
        jz = sense * s * (wx * jx[i] + wy * jy[i])
        jphi = sense * t * (wy * jx[i] - wx * jy[i])
        C[i] = jz * fz + jphi * fphi + jx[i] * bias_x[foot[i]] + jy[i] * bias_y[foot[i]]
        G[i] = jz * weight
        for j in range(i + 1):
            sense = 1.0 - 2.0 * foot[j]
            jz_j = sense * s * (wx * jx[j] + wy * jy[j])
            jphi_j = sense * t * (wy * jx[j] - wx * jy[j])
            M[i, j] = masses[foot[i]][foot[j]] * (jx[i] * jx[j] + jy[i] * jy[j])
            M[i, j] += kz * jz * jz_j + Iz * jphi * jphi_j
    M[0, 0] += M11
    M[1, 0] += M13
    M[1, 1] += M33
    M[2, 2] += M55
    M[3, 2] += M57
    M[3, 3] += M77
    C[0] -= f1
    C[1] += f1
    C[2] += f2
    C[3] -= f2
    C[4] += kb * q[4] + cb * qd[4]
    C[5] += kb * q[5] + cb * qd[5]
    for i in range(6):
        for j in range(i):
            M[j, i] = M[i, j]
