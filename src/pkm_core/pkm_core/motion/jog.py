"""
Pieces of a jog: a platform that follows a commanded velocity, with every piece ending at rest.

A change dv of the commanded velocity becomes a step with bounded jerk: the mean over `RISE` of the mean over `ROUND` of
the command. The velocity settles `RISE + ROUND` after the change. All coordinates share the two times, so a platform at
rest moves and stops along a straight line. A piece follows the command until its `hold`, then brakes in the same
time. The next piece begins at `hold`, from exactly this state.
"""

from dataclasses import dataclass, replace

import numpy as np

from pkm_core.errors import PkmError, TrajectoryError
from pkm_core.jet import Jet
from pkm_core.motion.planning import LONGEST_CYCLE
from pkm_core.motion.trajectory import SampledTrajectory, checked_joints, to_joints, with_derivatives

# [s] chosen: a piece takes 10 ms from its planning to the last controller; see `jog_stream.SILENCE` for the stop
PERIOD = 15e-3
# [s] chosen: a reversal at full speed stays within the thrust of every machine; both together are the time of a stop
RISE, ROUND = 16e-3, 8e-3
# [s] rest after a stop, in which the end of the cycle is measured
SETTLE = 20e-3
# [m/s], [rad/s] chosen: half a millimetre per stop at full speed
FASTEST, FASTEST_TURN = 0.05, 0.5
# parts of a command that are tried before the platform stops at a limit
_PARTS = (1.0, 0.4, 0.0)
_SAME = 1e-9  # [s] two times that differ by less are one: far below a sample


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece of a jog."""

    offset: int  # [samples] its first sample in the cycle
    hold: int  # [samples] the sample of the cycle at which the next piece begins
    poses: SampledTrajectory
    end: np.ndarray  # (n,) [m] joint positions at which it ends
    limited: str = ''  # the limit for which the platform moves slower than commanded

    @property
    def samples(self):
        """Length of the cycle with this piece."""
        return self.offset + len(self.poses)


def check_twist(machine, twist):
    """
    Return the velocities (m,) of the coordinates of `machine` in `twist`, {x, y, z, phi: velocity [m/s, rad/s]}.

    Raises
    ------
    TrajectoryError
        If a value is not finite, too large, or of a coordinate that the machine does not have.

    """
    for name, value in twist.items():
        limit, unit = (FASTEST_TURN, 'rad/s') if name in ('phi', 'wx', 'wy') else (FASTEST, 'm/s')
        if not np.isfinite(value):
            raise TrajectoryError(f'jog: velocity of {name} is {value} {unit}; expected a finite number')
        if value != 0 and name not in machine.coordinates:
            raise TrajectoryError(
                f'jog: velocity of {name} is {value:g} {unit}; {machine.name} moves {", ".join(machine.coordinates)} '
                f'only: expected 0'
            )
        if abs(value) > limit:
            raise TrajectoryError(
                f'jog: velocity of {name} is {value:g} {unit}; allowed -{limit:g} to {limit:g} {unit}'
            )
    return np.array([twist[name] for name in machine.coordinates], dtype=float)


class JogPlanner:
    """
    Plans the pieces of one jog.

    Parameters
    ----------
    machine : Machine
    start : ndarray, shape (n,)
        Joint positions where it stands [m].
    check : callable
        ``check(joints)`` raises `PkmError` for a joint trajectory that the drives cannot follow.

    """

    def __init__(self, machine, start, check):
        self._machine, self._check, self._start = machine, check, np.array(start, dtype=float)
        self._samples = lambda time: round(time / machine.sample_time)
        self._position = machine.forward(self._start)  # pose at `_at`, without the steps
        self._velocity = np.zeros(len(machine.coordinates))  # of the steps that have settled
        self._steps = []  # (sample, change of velocity) that have not
        self._target = np.zeros(len(machine.coordinates))
        self._at = 0  # [samples] begin of the next piece
        self._limited = ''  # of the last piece

    @property
    def is_long(self):
        """Whether the jog has to stop: a cycle is finite."""
        return self._at * self._machine.sample_time >= LONGEST_CYCLE

    @property
    def rests(self):
        """Whether nothing moves at the begin of the next piece."""
        return not (self._steps or self._velocity.any())

    def next(self, twist):
        """
        Return the next `Piece`, which follows `twist` (m,) [m/s, rad/s] as far as the limits allow.

        The first one rests, whatever the twist is: the machine starts it when every node is ready. `PkmError` if even a
        stop is refused; the brake of the previous piece has been checked and stays valid.
        """
        twist = np.zeros_like(self._target) if self._at == 0 or self.is_long else np.asarray(twist, dtype=float)
        limited = ''
        for part in _PARTS:
            target = part * twist
            steps = [*self._steps, (self._at, target - self._target)] if (target != self._target).any() else self._steps
            try:
                piece = self._piece(steps, target)
            except PkmError as error:
                if not target.any():
                    raise
                limited = limited or self._limited or self._reason(steps, target, error)
                continue
            self._settle(steps, piece.hold)
            self._target, self._limited = target, limited
            return replace(piece, limited=limited)
        raise AssertionError  # the last part is zero

    def _piece(self, steps, target):
        """Return the piece with these `steps`; `PkmError` if it is out of a limit."""
        poses, hold = self._poses(steps, target)
        machine = self._machine
        machine.check_pose(poses.position)
        joints = with_derivatives(poses, machine.joints, machine.inverse(Jet.from_derivatives(*poses.derivatives())))
        self._check(checked_joints(machine, joints))
        return Piece(self._at, hold, poses, joints.position[-1])

    def _reason(self, steps, target, error):
        """Return why a piece is refused, with the reachable interval of each coordinate; takes a while."""
        try:
            to_joints(self._machine, self._poses(steps, target)[0])
        except PkmError as reason:
            return str(reason).removeprefix('trajectory: ')
        return str(error).removeprefix('trajectory: ')

    def _poses(self, steps, target):
        """Return the poses of a piece and its `hold`."""
        hold = self._at + self._samples(PERIOD)
        stop = hold + self._samples(RISE + ROUND)
        at = np.arange(self._at, stop + self._samples(SETTLE))
        rows = self._course([*steps, (hold, -target)], at)
        moves = np.array([0]), np.array([stop - self._at])
        return SampledTrajectory(self._machine.sample_time, self._machine.coordinates, *rows, *moves), hold

    def _course(self, steps, at):
        """Return position, velocity, acceleration and jerk (N, m) of the samples `at` (N,)."""
        time = self._machine.sample_time
        elapsed = (time * (at - self._at))[:, np.newaxis]
        rows = np.zeros((4, len(at), len(self._velocity)))
        rows[0] += self._position + elapsed * self._velocity
        rows[1] += self._velocity
        for begin, change in steps:
            rows += _step(time * (at - begin))[:, :, np.newaxis] * change
        return rows

    def _settle(self, steps, hold):
        """Move the begin of the next piece to `hold`; steps that have settled there become velocity."""
        time, width = self._machine.sample_time, RISE + ROUND
        settled = [step for step in steps if time * (hold - step[0]) > width - _SAME]
        self._position = self._position + time * (hold - self._at) * self._velocity
        for begin, change in settled:
            self._position = self._position + (time * (hold - begin) - 0.5 * width) * change
            self._velocity = self._velocity + change
        self._steps = [step for step in steps if time * (hold - step[0]) <= width - _SAME]
        self._at = hold
        if not self._steps and np.abs(self._velocity).max() < 1e-12:  # rounding of the sum
            self._velocity = np.zeros_like(self._velocity)


def _step(elapsed):
    """Return position, velocity, acceleration and jerk (4, N) of a step of the velocity from 0 to 1 at 0 s."""
    rows = np.zeros((4, len(elapsed)))
    for begin, sign in ((0.0, 1.0), (ROUND, -1.0), (RISE, -1.0), (RISE + ROUND, 1.0)):
        on = elapsed > begin - _SAME
        since = np.where(on, np.maximum(elapsed - begin, 0.0), 0.0)
        jerk = np.where(on, sign / (RISE * ROUND), 0.0)
        rows += jerk * np.array([since**3 / 6.0, since**2 / 2.0, since, np.ones_like(since)])
    settled = elapsed > RISE + ROUND - _SAME  # without the rounding of the sum
    exact = np.array([elapsed - 0.5 * (RISE + ROUND), np.ones_like(elapsed), *np.zeros((2, len(elapsed)))])
    return np.where(settled, exact, rows)
