"""
Monitor of learning on the machine: detects divergence within two cycles and returns to the best feedforward.

The convergence test before the start uses models; the monitor uses the measured error. One `Monitor` per joint.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.errors import LearningError

GROWTH = 1.5  # twice in a row: an unstable law or a wrong sign
LEVEL = 3.0  # times the level reached, in two cycles in a row: slow divergence, or a changed machine
LOST = 0.25  # of the improvement by learning; friction that does not repeat costs less
FLOOR = 2e-6  # [m] rms; errors below it are within the tolerance of 5 um and may be noise of encoder and friction
RETRY = 30  # [cycles]; a second divergence within this number ends learning


@dataclass(frozen=True)
class Decision:
    """Decision after a cycle."""

    feedforward: np.ndarray  # (N,) [V] to update, or to use unchanged in the next cycle
    learn: bool  # whether the law updates it
    iteration: int  # number of updates it has had
    message: str  # the detected divergence or saturation; '' if none


class Monitor:
    """
    Monitors one joint from cycle to cycle; use a new one for a new motion or law.

    The error of a cycle is its rms. The level reached is the lowest of the first error and of all means of three errors
    in a row; the single best cycle is no measure if friction does not repeat. Divergence means both:

    - The error grows by half twice in a row, away from that level, or is above three times the level for two cycles.
    - A quarter of the improvement by learning is lost.

    Then the feedforward with the lowest error is used again, and learning restarts from it with the first gains of the
    law. A restart is also right after a change of the machine. If the error diverges again within `RETRY` cycles,
    learning of this joint ends and the best feedforward is kept.

    Parameters
    ----------
    joint, signal : str
        Names of what is monitored and of the learned signal, for messages.
    limit : float
        Of the learned signal, in its unit; a signal that reaches it is reported once.

    Attributes
    ----------
    best : ndarray, shape (N,)
        Feedforward [V] with the lowest error since learning was last started; empty before the first cycle.

    """

    def __init__(self, joint, limit=np.inf, signal='feedforward'):
        self.joint, self._signal = joint, signal
        self._limit, self._saturates = limit, False
        self.best = np.zeros(0)
        self._returned = self._ended = False
        self._begin()

    def _begin(self):
        self._cycles, self._recent, self._lowest, self._first, self._level = 0, [], np.inf, np.inf, np.inf

    def observe(self, error, feedforward):
        """
        Return the `Decision` after a cycle with this `error` (N,) [m] under this `feedforward` (N,) [V].

        Raises
        ------
        LearningError
            If a value is not finite.

        """
        rms, feedforward = float(np.sqrt(np.mean(np.square(error)))), np.array(feedforward, dtype=np.float64)
        if not (np.isfinite(rms) and np.isfinite(feedforward).all()):
            raise LearningError(f'monitor {self.joint}: error or feedforward is not finite')
        if self._ended:
            return Decision(self.best, False, 0, '')
        if rms < self._lowest:
            self._lowest, self.best = rms, feedforward
        self._recent = [*self._recent[-2:], rms]
        self._cycles += 1
        if self._cycles == 1:
            self._first = self._level = rms
        if self._cycles >= 3:
            if self._diverges():
                return self._go_back()
            self._level = min(self._level, sum(self._recent) / 3)
        return Decision(feedforward, True, self._cycles - 1, self._saturation(feedforward))

    def _saturation(self, feedforward):
        """Return a message the first time that the feedforward reaches the limit of the drive, else ''."""
        count = np.count_nonzero(np.abs(feedforward) >= self._limit * (1 - 1e-6))
        if not count or self._saturates:
            return ''
        self._saturates = True
        return (
            f'{self.joint}: the learned feedforward is at the limit of the drive, {self._limit:g} V, in {count} of '
            f'{len(feedforward)} samples; the error there cannot be learned; a longer move_time needs less'
        )

    def _diverges(self):
        before, last, now = self._recent
        lost = now > max(FLOOR, self._level + LOST * (self._first - self._level))
        grows = now > GROWTH * last and last > GROWTH * max(before, self._level)
        return lost and (grows or min(last, now) > LEVEL * self._level)

    def _go_back(self):
        self._ended = self._returned and self._cycles <= RETRY
        self._returned = True
        message = (
            f'learning of {self.joint} diverges: {", ".join(f"{1e6 * rms:.1f}" for rms in self._recent)} um rms in the '
            f'last cycles; returned to the {self._signal} with {1e6 * self._lowest:.1f} um, '
            + ('learning ends after the second divergence' if self._ended else 'learning restarts')
        )
        self._begin()
        return Decision(self.best, False, 0, message)
