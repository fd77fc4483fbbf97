"""
Elasticity between linkage and end point, which the laser measures and the encoders do not.

The platform is a mass on a damped spring, the same in every coordinate. Its deflection e from the pose x of the linkage
obeys

    e'' + 2 z w e' + w^2 e = -x'',

0.5 um at 4 m/s^2 and 450 Hz. Like the modes of the axes it exerts no force on the linkage.
"""

import numpy as np
from numba import njit
from scipy.linalg import expm


class Platform:
    """
    The platform of one machine, followed tick by tick from rest.

    Parameters
    ----------
    platform : truth.Platform
    size : int
        Number of coordinates m.
    sample_time : float
        One tick [s].

    """

    def __init__(self, platform, size, sample_time):
        w = 2.0 * np.pi * platform.resonance
        system = np.zeros((3, 3))  # of (e, e', x''), constant x'' over a tick
        system[0, 1] = 1.0
        system[1] = [-w * w, -2.0 * platform.damping * w, -1.0]
        self._step = expm(system * sample_time)[:2]
        self._sample_time = sample_time
        self._state = np.zeros((2, size))

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


@njit(cache=True, error_model='numpy')
def _follow(path, a, acceleration):
    """Fill `path` (T, 2, m) from its first row, the initial state."""
    for k in range(len(path) - 1):
        for i in range(path.shape[2]):
            e, rate, forced = path[k, 0, i], path[k, 1, i], acceleration[k, i]
            path[k + 1, 0, i] = a[0, 0] * e + a[0, 1] * rate + a[0, 2] * forced
            path[k + 1, 1, i] = a[1, 0] * e + a[1, 1] * rate + a[1, 2] * forced
