"""
The watch over learning on the machine: notices divergence within two cycles, and goes back to the best feedforward.

The convergence test before the start knows models; this knows only what came of it. A `Monitor` watches one joint.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.errors import LearningError

GROWTH = 1.5  # twice in a row: an unstable law, an error of sign
LEVEL = 3.0  # times the level reached, two cycles in a row: slow divergence, or a machine that has changed
LOST = 0.25  # of what learning had won; friction that does not repeat costs less
FLOOR = 2e-6  # [m] rms; below, the tolerance of 5 um is not at stake, and noise of encoder and friction may grow so
RETRY = 30  # [cycles] after going back, within which going back again ends learning


@dataclass(frozen=True)
class Decision:
    """What to do after a cycle."""

    feedforward: np.ndarray  # (N,) [V] to update, or to drive the next cycle with as it is
    learn: bool  # whether to ask the law for an update of it
    iteration: int  # how many updates it has had
    message: str  # what was noticed; '' if nothing


class Monitor:
    """
    Watches one joint from cycle to cycle; use a new one for a new motion or law.

    The error of a cycle is its rms. The level reached is the lowest of the first cycle's and of the means of any three
    in a row; the luckiest single cycle is no measure where friction does not repeat. The error diverges if it grows by
    half twice in a row, away from that level, or stays above three times the level for two cycles, and a good part of
    what had been won is lost. Then the feedforward with the lowest error is driven again and learning begins anew from
    it, with the first gains of the law, which also is what a change of the machine asks for. If it soon diverges once
    more, learning of this joint ends and the best feedforward stays.

    Attributes
    ----------
    best : ndarray, shape (N,)
        Feedforward [V] with the lowest error since learning last began; empty before the first cycle.

    """

    def __init__(self, joint):
        self.joint = joint
        self.best = np.zeros(0)
        self._returned = self._ended = False
        self._begin()

    def _begin(self):
        self._cycles, self._recent, self._lowest, self._first, self._level = 0, [], np.inf, np.inf, np.inf

    def observe(self, error, feedforward):
        """
        Return the `Decision` after a cycle with this `error` (N,) [m], driven with this `feedforward` (N,) [V].

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
        return Decision(feedforward, True, self._cycles - 1, '')

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
            f'last cycles; back to the feedforward that left {1e6 * self._lowest:.1f} um, '
            + ('where it stays, for this is the second time' if self._ended else 'and learning anew')
        )
        self._begin()
        return Decision(self.best, False, 0, message)
