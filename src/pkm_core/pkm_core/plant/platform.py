"""
Elasticity between linkage and end point, which the laser measures and the encoders do not.

The platform is a mass on a damped spring in each coordinate. Its deflection e from the pose x of the linkage obeys

    e'' + 2 z w e' + w^2 e = -x'',

0.5 um at 4 m/s^2 and 450 Hz. Like the modes of the axes it exerts no force on the linkage.

In `elastic` of four_dof, w and z of each coordinate follow from the linkage at home. With the sliders held, joint i
carries the mass m_i, the diagonal of the linkage's mass matrix M_l without sliders. Its identified second mode, w_i and
z_i (Table 8.1), gives the stiffness k_i = m_i w_i^2 and the damping c_i = 2 z_i w_i m_i. Under an acceleration in
coordinate j alone the end point deflects by 1/w_j^2 = (J k^-1 M_l J^-1)_jj, and 2 z_j/w_j = (J k^-1 c J^-1)_jj.
"""

import numpy as np
from numba import njit
from scipy.linalg import expm


class Platform:
    """
    The platform of one machine, followed tick by tick from rest.

    Parameters
    ----------
    modes : sequence of truth.Platform
        One per coordinate, m in all.
    sample_time : float
        One tick [s].

    """

    def __init__(self, modes, sample_time):
        self._step = np.array([_step(mode, sample_time) for mode in modes])
        self._sample_time = sample_time
        self._state = np.zeros((2, len(modes)))

    def follow(self, velocity):
        """
        Return deflection and its rate at each tick, two arrays (T, m) [m, rad], [m/s, rad/s].

        `velocity` (T, m) is that of the linkage [m/s, rad/s], from the last tick of the previous call on.
        """
        path = np.empty((len(velocity), *self._state.shape))
        path[0] = self._state
        _follow(path, self._step, np.diff(velocity, axis=0) / self._sample_time)
        self._state = path[-1].copy()
        return path[:, 0], path[:, 1]


def _step(mode, sample_time):
    """Return the rows e and e' (2, 3) of one tick of (e, e', x''), exact for constant x''."""
    w = 2.0 * np.pi * mode.resonance
    system = np.zeros((3, 3))
    system[0, 1] = 1.0
    system[1] = [-w * w, -2.0 * mode.damping * w, -1.0]
    return expm(system * sample_time)[:2]


@njit(cache=True, error_model='numpy')
def _follow(path, steps, acceleration):
    """Fill `path` (T, 2, m) from its first row, the initial state, with `steps` (m, 2, 3)."""
    for k in range(len(path) - 1):
        for i in range(path.shape[2]):
            e, rate, forced, a = path[k, 0, i], path[k, 1, i], acceleration[k, i], steps[i]
            path[k + 1, 0, i] = a[0, 0] * e + a[0, 1] * rate + a[0, 2] * forced
            path[k + 1, 1, i] = a[1, 0] * e + a[1, 1] * rate + a[1, 2] * forced
