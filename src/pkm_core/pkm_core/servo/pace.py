"""When a tick may begin in wall time, how late it begins, and the time of a machine at rest. No ROS, no clock."""

from dataclasses import dataclass
from enum import Enum
from math import ceil, isfinite, nan

import numpy as np

from pkm_core.errors import PkmError

SLOWEST, FASTEST = 0.01, 1000.0
ALLOWED = f'allowed: 0 (as fast as possible), or {SLOWEST:g} to {FASTEST:g} times real time'
# descriptions of the parameters `pace` and `time`, and the values of the latter
PACE = f'simulated time per wall time: 1.0 is real time, {SLOWEST:g} to {FASTEST:g}; 0: as fast as possible'
TIME = 'between cycles simulated time is standing, or continuous: then /clock continues'
TIMES = ('standing', 'continuous')
# [ticks] whose lateness is kept: 8 s in real time
KEPT = 16384
# [s, wall] a schedule that is further behind restarts: a held-up computer does not race afterwards
_FORGIVEN = 0.1


def checked_pace(value, where):
    """Return the pace `value`; `PkmError` beginning with `where` unless it is 0 or from `SLOWEST` to `FASTEST`."""
    if value == 0 or (isfinite(value) and SLOWEST <= value <= FASTEST):
        return value
    raise PkmError(f'{where}: {value} given; {ALLOWED}')


@dataclass(frozen=True)
class Lateness:
    """Delay from the time a tick was due to its begin, over the last ticks; nan without a tick."""

    ticks: int
    mean: float  # [s, wall]
    percentile_99: float  # [s, wall]
    largest: float  # [s, wall]
    share: float  # [1] of ticks that were late by more than the wall time of a tick


class Turn(Enum):
    """Whether the next tick may begin."""

    NOW = 'now'
    LATER = 'at its due time'
    PAUSED = 'after a step, or after the pause'


class Pace:
    """
    The pace of the simulated time of one machine, and its pauses.

    Times are [s, monotonic]. `tick` is the current tick. Nothing is computed per tick while `is_free`.

    Parameters
    ----------
    sample_time : float
        [s] simulated time of a tick.
    factor : float
        Simulated time per wall time, 0: as fast as possible.

    Attributes
    ----------
    factor : float
        As set last.
    paused : bool
        Whether only single steps are made.

    """

    def __init__(self, sample_time, factor=0.0):
        self.paused = False
        self._steps = 0  # ticks that begin although paused
        self._sample_time = sample_time
        self._late = np.zeros(KEPT)  # [s] a ring
        self.set(factor, 0, 0.0)

    @property
    def is_free(self):
        """Whether ticks follow each other without a wait."""
        return not (self.factor or self.paused)

    def set(self, factor, tick, now):
        """Set the pace; its figures restart."""
        self.factor, self._number, self._reached = factor, 0, nan
        self._period = self._sample_time / factor if factor else 0.0  # [s, wall]
        self.begin(tick, now)

    def pause(self, tick, now):
        """Begin no tick until `step` or `resume`."""
        self.end(tick, now)
        self.paused = True

    def resume(self, tick, now):
        """End a pause."""
        self.paused, self._steps = False, 0
        self.begin(tick, now)

    def step(self):
        """Let one more tick begin during the pause; return the number of those that have not begun."""
        self._steps += 1
        return self._steps

    def begin(self, tick, now):
        """Let `tick` be due now: a cycle starts, or the pace has changed."""
        self._first, self._begun = tick, now
        self._since = None if self.paused else (tick, now)

    def end(self, tick, now):
        """Keep the figure of `reached` at the end of a cycle."""
        self._reached, self._since = self.reached(tick, now), None

    def due(self, tick):
        """Return the time at which `tick` is due."""
        return self._begun + (tick - self._first) * self._period

    def turn(self, tick, now):
        """Return the `Turn` of `tick`; with `NOW` it is noted that it begins."""
        if self.paused:
            if not self._steps:
                return Turn.PAUSED
            self._steps -= 1
        elif self.factor:
            late = now - self.due(tick)
            if late < 0:
                return Turn.LATER
            self._late[self._number % KEPT] = late
            self._number += 1
            if late > _FORGIVEN:
                self._first, self._begun = tick, now
        return Turn.NOW

    def reached(self, tick, now):
        """
        Return the simulated time per wall time, nan before the first ticks.

        It counts from the start of the cycle, the end of a pause or the change of the pace, whichever was last. Between
        cycles and in a pause it is that of the last stretch.
        """
        if self._since is None or tick <= self._since[0] or now <= self._since[1]:
            return self._reached
        return (tick - self._since[0]) * self._sample_time / (now - self._since[1])

    def lateness(self):
        """Return the `Lateness` of the last `KEPT` ticks since the pace was set."""
        number = min(self._number, KEPT)
        if not number:
            return Lateness(0, nan, nan, nan, nan)
        late = self._late[:number]
        place = ceil(0.99 * number) - 1
        return Lateness(
            number,
            float(late.mean()),
            float(np.partition(late, place)[place]),
            float(late.max()),
            float(np.count_nonzero(late > self._period) / number),
        )


class RestClock:
    """
    Simulated time that passes while the machine stands.

    A cycle must not depend on how long the machine stood. So its first tick comes a whole number of `step` ticks after
    the end of the previous cycle: everything that happens every n-th tick, and the clock of the laser, has its phase.

    Parameters
    ----------
    step : int
        [ticks]

    """

    def __init__(self, step):
        self._step, self._passed, self._last = step, 0.0, None

    @property
    def ticks(self):
        """Ticks that have passed since the machine stands."""
        return int(self._passed)

    def look(self, now, rate):
        """Let time pass until `now` [s], at `rate` [ticks/s] since the last look."""
        if self._last is not None:
            self._passed += rate * (now - self._last)
        self._last = now

    def leave(self):
        """Return the ticks by which the number of the current tick grows before a cycle begins, and count from 0."""
        passed, self._passed, self._last = self.ticks, 0.0, None
        return ceil(passed / self._step) * self._step


def rest_step(sample_time, laser_sample_time, every, longest=1.0):
    """
    Return the `step` of a `RestClock` [ticks]: a multiple of `every` ticks and of the sample time of the laser.

    Raises
    ------
    PkmError
        If it is longer than `longest` [s]: the two sample times have no short common multiple.

    """
    tick, sample = round(sample_time * 1e9), round(laser_sample_time * 1e9)
    step = int(np.lcm(every * tick, sample)) // tick
    if step * sample_time > longest:
        raise PkmError(
            f'time: continuous given; sample times of {sample_time} s and of {laser_sample_time} s (laser) have no '
            f'common multiple up to {longest:g} s; allowed: standing'
        )
    return step
