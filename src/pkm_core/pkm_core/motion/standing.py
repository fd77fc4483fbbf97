"""Where the machine stands between two cycles, as one node finds it."""

import numpy as np

from pkm_core.motion.trajectory import AT_HOME, checked_cycle

# [m] chosen: ten times the error of a standing axis, 1.6 um in the environment `hard` after cycles without learning; a
# position that is read from the encoders differs from the reference by this error
NEAR = 20e-6


class Standing:
    """
    Joint positions at which the next cycle begins.

    They are the last reference of the cycle that has ended. The machine reports its encoders: after a reset, or to a
    node that has been restarted, the report replaces the reference, because it differs by more than `NEAR`.

    Parameters
    ----------
    machine : Machine

    Attributes
    ----------
    position : ndarray, shape (n,)
        [m]; exactly home if the machine stands there.

    """

    def __init__(self, machine):
        self._machine = machine
        self.position = machine.home
        self._cycle = 0  # the last one that has ended

    @property
    def is_at_home(self):
        """Whether the machine stands at home."""
        return np.array_equal(self.position, self._machine.home)

    def ended(self, cycle, position):
        """Note that `cycle` has ended at the reference `position` (n,) [m]."""
        self._cycle = cycle
        self.position = self._machine.home if _is_near(position, self._machine.home, AT_HOME) else np.array(position)

    def reset(self):
        """Note that the machine has been moved home."""
        self.position = self._machine.home

    def reported(self, cycle, joints, position):
        """
        Take the report of the machine: `position` (n,) [m] of `joints` by the encoders after `cycle`.

        A late report, of other joints, or with a value that is not finite is ignored.
        """
        position = np.asarray(position, dtype=float)
        late = 0 < cycle < self._cycle  # 0 is of a machine that has been started again
        if late or tuple(joints) != self._machine.joints or position.shape != self.position.shape:
            return
        if not np.isfinite(position).all() or _is_near(position, self.position, NEAR):
            return
        self._cycle = cycle
        self.position = self._machine.home if _is_near(position, self._machine.home, NEAR) else position

    def check(self, trajectory, *, stay=False):
        """
        Return the joint `trajectory` if it can be the next cycle, see `checked_cycle`; `stay` as there.

        At home its begin is exact to `AT_HOME`. Elsewhere it may differ by `NEAR`: the trajectory source may have been
        restarted.
        """
        tolerance = AT_HOME if self.is_at_home else NEAR
        return checked_cycle(self._machine, trajectory, self.position, stay=stay, tolerance=tolerance)


def _is_near(one, other, distance):
    return bool(np.abs(one - other).max() <= distance)
