"""
Tolerances of a joint trajectory, as the JointTrajectoryController of ros2_controllers (branch jazzy) applies them.

A path tolerance bounds the error of a joint while the trajectory moves. A goal tolerance is met at the first tick at or
after the end of the trajectory at which every joint is within its own. Without a tolerance nothing is bounded.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pkm_core.errors import FollowError

# an "erased" tolerance, and how exactly it is written there: a C++ float of -1
_ERASED, _EPSILON = -1.0, 1.2e-7
_BOUNDED = ('velocity', 'acceleration')
# [s] how far the start may lie ahead of the simulated time that was last reported, every 0.1 s of wall time
_AHEAD = 1.0


@dataclass(frozen=True)
class JointTolerance:
    """Tolerance of one joint: 0 is not given, -1 is no tolerance."""

    name: str
    position: float = 0.0  # [m]
    velocity: float = 0.0  # [m/s]; not measured, so that only 0 and -1 are accepted
    acceleration: float = 0.0  # [m/s^2]; the same


@dataclass(frozen=True, eq=False)
class Tolerances:
    """
    Tolerances of a goal; `inf` is none.

    Errors are reference minus measured position [m]. Times of messages count from the start of the trajectory.
    """

    joints: tuple[str, ...]
    path: np.ndarray  # (n,) [m]
    goal: np.ndarray  # (n,) [m]
    goal_time: float  # [s] after the end of the trajectory

    PATH: ClassVar[str] = 'PATH_TOLERANCE_VIOLATED'
    GOAL: ClassVar[str] = 'GOAL_TOLERANCE_VIOLATED'

    @property
    def bounded(self):
        """Names of the joints that have a tolerance."""
        given = np.isfinite(self.path) | np.isfinite(self.goal)
        return [joint for joint, is_given in zip(self.joints, given, strict=True) if is_given]

    def check_path(self, errors, times):
        """
        Raise `FollowError` at the first sample outside the path tolerance.

        Parameters
        ----------
        errors : array_like, shape (N, n)
            [m]; a value that is not finite is outside every tolerance.
        times : array_like, shape (N,)
            [s]

        """
        outside = _outside(np.asarray(errors), self.path)
        if outside.any():
            sample = int(np.argmax(outside.any(axis=1)))
            self._refuse(self.PATH, errors[sample], self.path, f'at {times[sample]:.4f} s')

    def check_cycle(self, errors, start, end, sample_time):
        """
        Raise `FollowError` if a cycle is outside the path tolerance or does not come within the goal tolerance.

        The goal tolerance applies up to `goal_time` after the end, and no longer than the cycle.

        Parameters
        ----------
        errors : ndarray, shape (N, n)
            Of every tick [m].
        start, end : int
            First sample of the trajectory, and the sample of its end.
        sample_time : float
            [s]

        """
        self.check_path(errors[start:end], sample_time * np.arange(end - start))
        most = len(errors) - 1 - end
        ticks = most if self.goal_time == math.inf else min(most, int(self.goal_time / sample_time + 1e-9))
        rest = errors[end : end + ticks + 1]
        if _outside(rest, self.goal).any(axis=1).all():
            when = f'{sample_time * ticks:g} s after the end'
            self._refuse(self.GOAL, rest[-1], self.goal, when)

    def _refuse(self, code, error, bounds, when):
        """Name the joint that is furthest outside its bound."""
        with np.errstate(invalid='ignore'):
            excess = np.where(_outside(error, bounds), np.nan_to_num(np.abs(error), nan=np.inf) / bounds, -1.0)
        column = int(np.argmax(excess))
        kind = 'path' if code == self.PATH else 'goal'
        raise FollowError(
            code,
            f'{kind}_tolerance: error of {self.joints[column]} is {1e6 * error[column]:.4g} um {when}; '
            f'allowed: {1e6 * bounds[column]:.4g} um',
        )


def tolerances_of(joints, path=(), goal=(), goal_time=0.0):
    """
    Return the `Tolerances` of a goal.

    The JointTrajectoryController replaces a tolerance that it does not understand by its default; here it is refused.

    Parameters
    ----------
    joints : sequence of str
        Of the machine.
    path, goal : sequence of JointTolerance
        Joints without one have none.
    goal_time : float
        [s]; 0 and -1 are no bound.

    Raises
    ------
    FollowError
        If a joint is unknown or named twice, or a value is negative other than -1, not finite, or of a quantity that
        is not measured.

    """
    joints = tuple(joints)
    bounds = {'path_tolerance': np.full(len(joints), np.inf), 'goal_tolerance': np.full(len(joints), np.inf)}
    for kind, given in zip(bounds, (path, goal), strict=True):
        names = [tolerance.name for tolerance in given]
        if len(set(names)) < len(names) or not set(names) <= set(joints):
            raise FollowError('INVALID_JOINTS', f'{kind}: joints {names}; allowed: each of {list(joints)} once')
        for tolerance in given:
            for name in _BOUNDED:
                if _bound(f'{kind}: {name} of {tolerance.name}', getattr(tolerance, name)) < math.inf:
                    raise FollowError(
                        'INVALID_GOAL',
                        f'{kind}: {name} of {tolerance.name} is {getattr(tolerance, name):g}; expected 0 or -1: only '
                        f'positions are measured',
                    )
            bounds[kind][joints.index(tolerance.name)] = _bound(
                f'{kind}: position of {tolerance.name}', tolerance.position
            )
    wait = _bound('goal_time_tolerance', goal_time)
    return Tolerances(joints, bounds['path_tolerance'], bounds['goal_tolerance'], wait)


def check_start(stamp, duration, now):
    """
    Refuse a trajectory by the time in its header: `FollowError`.

    Parameters
    ----------
    stamp : float
        [s] of its start; 0 starts at once.
    duration : float
        [s]
    now : float
        [s] simulated time that the machine has last reported.

    """
    if stamp == 0:
        return
    if stamp + duration < now:
        raise FollowError(
            'OLD_HEADER_TIMESTAMP',
            f'header.stamp: the trajectory ends at {stamp + duration:.4f} s; allowed: after the simulated time, '
            f'{now:.4f} s, or stamp 0',
        )
    if stamp > now + _AHEAD:
        raise FollowError(
            'INVALID_GOAL',
            f'header.stamp is {stamp:.4f} s; allowed: 0, or at most {_AHEAD:g} s after the simulated time, {now:.4f} s',
        )


def _bound(where, value):
    """Return the bound that a value of a message means, inf for none."""
    if not math.isfinite(value) or (value < 0 and abs(value - _ERASED) > _EPSILON):
        raise FollowError('INVALID_GOAL', f'{where} is {value:g}; allowed: 0 or more, or -1 (no tolerance)')
    return value if value > 0 else math.inf


def _outside(errors, bounds):
    return np.isfinite(bounds) & ~(np.abs(errors) <= bounds)
