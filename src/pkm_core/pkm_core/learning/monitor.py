"""
Monitor of learning on the machine: detects divergence and a changed machine, and restarts learning.

The convergence test before the start uses models; the monitor uses the measured error. One `Monitor` per joint.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.errors import LearningError

GROWTH = 1.5  # twice in a row: an unstable law or a wrong sign
LEVEL = 3.0  # times the level reached, in two cycles in a row: slow divergence, or a changed machine
LOST = 0.25  # of the improvement by learning; friction that does not repeat costs less
FLOOR = 2e-6  # [m] rms; errors below it are within the tolerance of 5 um and may be noise of encoder and friction
RISE_FLOOR = 0.5e-6  # [m] rms; about twice the noise of encoder and amplifier; a slow rise below it is harmless
RISE = 1.2  # twice in a row over means of three cycles: slow divergence
SIGMAS = 5.0  # of the slope over nine cycles, by the measured scatter; resampled `hard` runs: 1 alarm in 9000 cycles
STEADY = 1.1  # a raised error that grows by less than this is a changed machine, not a diverging law
RETRY = 30  # [cycles]; a divergence within this number after the last one pauses learning
PAUSE = 20  # [cycles] of the first pause; each further one is twice as long
_RISING = 9  # [cycles]
LEARNED = 4  # updates that a feedforward from a file counts as: the gains of a law that has converged, not its first


@dataclass(frozen=True)
class Decision:
    """Decision after a cycle."""

    feedforward: np.ndarray  # (N,) [V] to update, or to use unchanged in the next cycle
    learn: bool  # whether the law updates it
    iteration: int  # number of updates it has had
    message: str  # the detected divergence or change; '' if none


class Monitor:
    """
    Monitors one joint from cycle to cycle; use a new one for a new motion or law.

    The error of a cycle is its rms. The level reached is the lowest of the first error and of all means of three errors
    in a row; the single best cycle is no measure if friction does not repeat. Learning is interrupted if

    - a quarter of the improvement by learning is lost, and the error grows by half twice in a row, away from that
      level, or is above three times the level for two cycles;
    - or the mean of three cycles rises by a fifth twice in a row, by more than the scatter explains.

    If the error grew, the law diverges: the feedforward with the lowest error is used again. If it rose at once and
    stays, the machine has changed, for example its thrust: the present feedforward is kept. Learning restarts with the
    first gains of the law; after a slow rise with those after `LEARNED` updates. After a second divergence within
    `RETRY` cycles it pauses before it restarts; it never ends.

    Parameters
    ----------
    joint, signal : str
        Names of what is monitored and of the learned signal, for messages.
    updates : int
        Number of updates that the first signal has had.

    Attributes
    ----------
    best : ndarray, shape (N,)
        Feedforward [V] with the lowest error since learning was last started; empty before the first cycle.

    """

    def __init__(self, joint, updates=0, signal='feedforward'):
        self.joint, self._signal = joint, signal
        self.best = np.zeros(0)
        self._returned, self._pause, self._waiting = False, PAUSE, 0
        self._begin(updates)

    def _begin(self, updates=0):
        self._updates, self._errors, self._lowest, self._level = updates, [], np.inf, np.inf

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
        if self._waiting:
            self._waiting -= 1
            return Decision(self.best, False, 0, '')
        if rms < self._lowest:
            self._lowest, self.best = rms, feedforward
        self._errors.append(rms)
        if len(self._errors) == 1:
            self._level = rms
        if len(self._errors) >= 3:
            if self._is_lost() and self._is_raised():
                return self._restart(feedforward)
            if self._grows():
                return self._go_back(0)
            if self._rises():
                return self._go_back(LEARNED)
            self._level = min(self._level, sum(self._errors[-3:]) / 3)
        return Decision(feedforward, True, self._updates + len(self._errors) - 1, '')

    def _is_lost(self):
        """Return whether a quarter of the improvement by learning is lost."""
        return self._errors[-1] > max(FLOOR, self._level + LOST * (self._errors[0] - self._level))

    def _grows(self):
        before, last, now = self._errors[-3:]
        grown = now > GROWTH * last and last > GROWTH * max(before, self._level)
        return self._is_lost() and (grown or min(last, now) > LEVEL * self._level)

    def _is_raised(self):
        """Return whether the error rose at once, from about its level, and does not grow any more."""
        before, last, now = self._errors[-3:]
        raised = LEVEL * self._level
        return before < GROWTH * self._level and last > raised and raised < now < STEADY * last

    def _rises(self):
        """Return whether the error rises steadily over nine cycles, beyond the scatter from cycle to cycle."""
        if len(self._errors) < _RISING + 3:  # the first three converge
            return False
        last = np.array(self._errors[-_RISING:])
        first, second, third = last.reshape(3, -1).mean(axis=1)
        # second differences do not contain a steady rise
        sigma = np.sqrt(np.mean(np.diff(self._errors[3:][-3 * _RISING :], 2) ** 2) / 6)
        time = np.arange(_RISING) - (_RISING - 1) / 2
        slope, deviation = time @ last / (time @ time), sigma / np.sqrt(time @ time)
        return bool(third > max(RISE_FLOOR, RISE * second) and second > RISE * first and slope > SIGMAS * deviation)

    def _restart(self, feedforward):
        message = (
            f'{self.joint}: the error rose to {self._recent()} um rms and stays; the machine has changed: learning '
            f'restarts from the present {self._signal}'
        )
        self._begin(updates=1)
        return Decision(feedforward, True, 0, message)

    def _go_back(self, updates):
        again = self._returned and len(self._errors) <= RETRY
        self._returned = True
        after = f'learning pauses for {self._pause} cycles' if again else 'learning restarts'
        message = (
            f'learning of {self.joint} diverges: {self._recent()} um rms in the last cycles; returned to the '
            f'{self._signal} with {1e6 * self._lowest:.1f} um, {after}'
        )
        if again:
            self._waiting, self._pause = self._pause, 2 * self._pause
        self._begin(updates)
        return Decision(self.best, False, updates, message)

    def _recent(self):
        return ', '.join(f'{1e6 * rms:.1f}' for rms in self._errors[-3:])
