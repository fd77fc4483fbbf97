"""
Belt elasticity of the 4-DOF manipulator (thesis 5.6): its dynamics with the platform rotations psi_p, psi_q as joints 5, 6.

The belts hold the platforms under P and Q parallel to the base; when they give, the platform arms turn,
    P = (x1 - dy sin psi_p, Y1 + dy cos psi_p),   Q = (X2 + dx cos psi_q, y2 + dx sin psi_q),
against kb psi + cb psi'. As in the rigid model the platform's mass sits at P (Q); its own inertia is not known and left out.
"""

import math

from numba import njit

from pkm_core.dynamics import GRAVITY, _t_mechanism


@njit(cache=True)
def four_dof_belt_terms(q, qd, p, M, C, G):
    """
    Fill M (6, 6), C, G (6,) for q = [d1, d3, d5, d7, psi_p, psi_q]; formulation of theory notes 5.2 with a wider Jacobian.

    `p` is that of dynamics.four_dof_terms followed by kb [N m/rad] and cb [N m s/rad]; both belt torques stand in C.
    """
    l, k, dx, dy = p[0], p[1], p[2], p[3]
    m1, m2, m3, m4, m5, m6, m7, m8 = p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11]
    mp, mq, m9, m10, m11, m12, mef = p[12], p[13], p[14], p[15], p[16], p[17], p[18]
    r2, r4, r6, r8, r10, r12 = p[19], p[20], p[21], p[22], p[23], p[24]
    I2, I4, I6, I8, I9, I10, I11, I12, Ief = p[25], p[26], p[27], p[28], p[29], p[30], p[31], p[32], p[33]
    slender, kb, cb = p[34], p[35], p[36]

    h1, hd1 = 0.5 * (q[1] - q[0]), 0.5 * (qd[1] - qd[0])
    h2, hd2 = 0.5 * (q[2] - q[3]), 0.5 * (qd[2] - qd[3])
    M11, M13, M33, f1, c1, Y1, y1b = _t_mechanism(l, h1, hd1, (m1, m3), (m2, m4), (r2, r4), (I2, I4))
    M77, M57, M55, f2, c2, X2, x2b = _t_mechanism(l, h2, hd2, (m7, m5), (m8, m6), (r8, r6), (I8, I6))
    sp, cp, sq, cq = math.sin(q[4]), math.cos(q[4]), math.sin(q[5]), math.cos(q[5])
    J = (  # d(P, Q)/dq
        (0.5, 0.5, 0.0, 0.0, -dy * cp, 0.0),
        (c1, -c1, 0.0, 0.0, -dy * sp, 0.0),
        (0.0, 0.0, -c2, c2, 0.0, -dx * sq),
        (0.0, 0.0, 0.5, 0.5, 0.0, dx * cq),
    )
    bias = (  # of the acceleration of P, Q
        dy * sp * qd[4] ** 2,
        y1b - dy * cp * qd[4] ** 2,
        x2b - dx * cq * qd[5] ** 2,
        -dx * sq * qd[5] ** 2,
    )
    wx = X2 + dx * cq - 0.5 * (q[0] + q[1]) + dy * sp
    wy = 0.5 * (q[2] + q[3]) + dx * sq - Y1 - dy * cp
    wdx = wdy = 0.0
    for j in range(6):
        wdx += (J[2][j] - J[0][j]) * qd[j]
        wdy += (J[3][j] - J[1][j]) * qd[j]
    wbx, wby = bias[2] - bias[0], bias[3] - bias[1]

    # the vertical T-mechanism on w = PQ, as in four_dof_terms
    RR = 0.25 * (wx * wx + wy * wy)
    RRd = 0.5 * (wx * wdx + wy * wdy)
    Z = math.sqrt(k * k - RR)
    zd = -0.5 * RRd / Z
    phid = (wx * wdy - wy * wdx) / (4.0 * RR)
    zb = -(zd * zd + 0.25 * (wdx * wdx + wdy * wdy + wx * wbx + wy * wby)) / Z
    phib = (wx * wby - wy * wbx) / (4.0 * RR) - phid * RRd / RR
    s, t = 0.25 / Z, 0.25 / RR
    gz = (s * wx, s * wy, -s * wx, -s * wy)
    gphi = (t * wy, -t * wx, -t * wy, t * wx)

    ra, rb = r10 / k, r12 / k
    mPP = mp + m9 + m10 * (1.0 - 0.5 * ra) ** 2 + m12 * (0.5 * rb) ** 2 + 0.25 * mef
    mQQ = mq + m11 + m10 * (0.5 * ra) ** 2 + m12 * (1.0 - 0.5 * rb) ** 2 + 0.25 * mef
    mPQ = m10 * (1.0 - 0.5 * ra) * 0.5 * ra + m12 * 0.5 * rb * (1.0 - 0.5 * rb) + 0.25 * mef
    mz = m10 * ra * ra + m12 * rb * rb + mef
    I_rods = I10 + I12
    dIz = slender * I_rods / (k * k)
    Iz = I9 + I11 + Ief + (1.0 - slender) * I_rods + dIz * RR
    fz = mz * zb + I_rods * (zb - 0.5 * zd * RRd / RR) / RR + dIz * Z * phid * phid
    fphi = Iz * phib + dIz * RRd * phid
    kz = mz + I_rods / RR
    weight = GRAVITY * (m10 * ra + m12 * rb + mef)

    for i in range(6):
        jz = jphi = 0.0
        for a in range(4):
            jz += gz[a] * J[a][i]
            jphi += gphi[a] * J[a][i]
        C[i] = jz * fz + jphi * fphi
        for a in range(2):
            C[i] += J[a][i] * (mPP * bias[a] + mPQ * bias[a + 2]) + J[a + 2][i] * (mPQ * bias[a] + mQQ * bias[a + 2])
        G[i] = jz * weight
        for j in range(i + 1):
            jz_j = jphi_j = total = 0.0
            for a in range(4):
                jz_j += gz[a] * J[a][j]
                jphi_j += gphi[a] * J[a][j]
            for a in range(2):
                total += J[a][i] * (mPP * J[a][j] + mPQ * J[a + 2][j])
                total += J[a + 2][i] * (mPQ * J[a][j] + mQQ * J[a + 2][j])
            M[i, j] = total + kz * jz * jz_j + Iz * jphi * jphi_j
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
