"""One cycle of a goal as the trajectory source sees it, from its trajectory to its metrics or the reason of its end."""

from dataclasses import dataclass, field
from enum import Enum
from math import inf

from pkm_core.servo.cycle_run import MOST_CYCLES

# [s] `look` is called every second; after a longer pause this process has not read its messages
_HELD_UP = 3.0


class GoalState(Enum):
    """State of the last cycle that was begun."""

    IDLE = 'idle'  # no cycle has been begun
    STARTING = 'starting'  # the trajectory is resent until the machine starts the cycle
    RUNNING = 'running'  # the machine runs the cycle
    AWAITING_METRICS = 'awaiting metrics'  # the machine has run it; metrics of some joints are missing
    ENDED = 'ended'
    STRAY = 'stray'  # ended for the goal, but the machine runs it: it was started after it was given up


@dataclass(frozen=True, slots=True)
class Send:
    """Send the messages of the cycle."""

    cycle: int


@dataclass(frozen=True, slots=True)
class WatchMachine:
    """Watch from now on whether the process of the machine exists."""


@dataclass(frozen=True, slots=True)
class StopCycle:
    """Publish a STOP event, which ends the cycle in the controllers."""

    cycle: int
    reason: str


@dataclass(frozen=True, slots=True)
class End:
    """
    End the wait for the cycle.

    `reason` is why it was not run, '' after a cycle that was. `errors` is the largest dynamic error [m] of each
    joint that reported one.
    """

    reason: str = ''
    errors: dict[str, float] = field(default_factory=dict)


class GoalCycle:
    """
    State machine of the cycles of a goal, one at a time.

    Every event is a method; it returns the tuple of actions to perform, in this order. A cycle that was begun gets
    exactly one `End`, unless another one is begun before. Events of other cycles are ignored. Times are
    [s, monotonic].

    Parameters
    ----------
    start_timeout : float
        [s] from `begin` to the STARTED event.
    metrics_timeout : float
        [s] from the FINISHED event to the metrics of all joints; a cycle without them has still been run.
    silence : float
        [s] without a report of a machine that has reported before, after which it counts as stuck.

    Attributes
    ----------
    state : GoalState
    cycle : int
        Number of the last cycle that was begun, 0 before the first one.

    """

    def __init__(self, start_timeout, metrics_timeout, silence=inf):
        self.state = GoalState.IDLE
        self.cycle = 0
        self._start_timeout = start_timeout
        self._metrics_timeout = metrics_timeout
        self._silence = silence
        self._heard: float | None = None  # time of the last report of the machine, None before the first one
        self._looked = -inf  # time of the last `look`
        self._over = False  # by the last report of the machine the cycle has ended
        self._stop_reason = ''  # why the cycle is stopped as soon as it starts
        self._highest = 0  # the highest number of a cycle in use
        self._deadline = inf
        self._errors = {}

    @property
    def is_on_machine(self):
        """Whether the machine is running the cycle."""
        return self.state in (GoalState.RUNNING, GoalState.STRAY)

    @property
    def next_cycle(self):
        """The number that `begin` gives the next cycle, as far as is known."""
        return self._highest + 1

    def begin(self, now):
        """Begin the next cycle, whose number no cycle of the machine has had."""
        self.cycle = self._highest = self._highest + 1
        self.state, self._deadline, self._errors = GoalState.STARTING, now + self._start_timeout, {}
        self._over, self._stop_reason = False, ''
        if self._heard is not None:
            self._heard = now  # its reports need not have been read between two goals
        return (Send(self.cycle),)

    def numbered(self, cycle):
        """Note that the machine has run `cycle`, for a trajectory source that started after it."""
        if cycle <= MOST_CYCLES:
            self._highest = max(self._highest, cycle)
        return ()

    def started(self, cycle):
        """Take a STARTED event."""
        if cycle == self.cycle and self.state in (GoalState.STARTING, GoalState.ENDED):
            self.state = GoalState.RUNNING if self.state is GoalState.STARTING else GoalState.STRAY
            return (WatchMachine(), *self.stop(self._stop_reason)) if self._stop_reason else (WatchMachine(),)
        return ()

    def stop(self, reason):
        """Stop the cycle: at once, or as soon as it starts. It ends with the FAULT event of the machine."""
        if self.state is GoalState.STARTING:
            self._stop_reason = reason
        return (StopCycle(self.cycle, reason),) if self.state is GoalState.RUNNING else ()

    def finished(self, cycle, now, expected):
        """Take a FINISHED event; joints named in `expected` report metrics."""
        if cycle != self.cycle:
            return ()
        if self.state in (GoalState.STARTING, GoalState.RUNNING):
            self.state, self._deadline = GoalState.AWAITING_METRICS, now + self._metrics_timeout
            return self._end_if_complete(expected)
        if self.state is GoalState.STRAY:
            self.state = GoalState.ENDED
        return ()

    def failed(self, cycle, reason):
        """Take a REFUSED or FAULT event."""
        if cycle != self.cycle:
            return ()
        if self.state in (GoalState.STARTING, GoalState.RUNNING):
            return self._end(reason)
        if self.state is GoalState.STRAY:
            self.state = GoalState.ENDED
        return ()

    def reported(self, now, state, cycle, fault, expected):
        """
        Take the diagnostics of the machine: the word for its state, its last started cycle, and its fault.

        They replace a FINISHED or FAULT event that was lost, with the second report of the same state.
        """
        self._heard, before = now, self._over
        begun = self.state in (GoalState.STARTING, GoalState.RUNNING)
        self._over = begun and cycle == self.cycle and state in ('standing', 'faulted')
        if not (before and self._over):
            return ()
        return self.failed(cycle, f'machine: {fault}') if state == 'faulted' else self.finished(cycle, now, expected)

    def metrics(self, cycle, joint, error, expected):
        """Take the largest dynamic error [m] of `joint`; joints named in `expected` report metrics."""
        if cycle != self.cycle:
            return ()
        self._errors[joint] = error
        return self._end_if_complete(expected) if self.state is GoalState.AWAITING_METRICS else ()

    def look(self, now, machine_ended, listeners):
        """
        Resend a trajectory, or end a wait that has taken too long; called regularly.

        `machine_ended` is whether the process of the machine that ran the cycle no longer exists, `listeners` who
        receives the trajectory, in words.
        """
        if now - self._looked > _HELD_UP and self._heard is not None:
            self._heard = now  # this process was held up: reports may wait in its queue
        self._looked = now
        silent = 0.0 if self._heard is None else now - self._heard
        if silent > self._silence and self.state in (GoalState.STARTING, GoalState.RUNNING):
            reason = f'the machine gives no sign of life for {silent:.0f} s: its process has ended, is stopped or stuck'
            return StopCycle(self.cycle, reason), *self._end(f'cycle {self.cycle}: {reason}; end it and start it again')
        if self.state is GoalState.STARTING:
            if now <= self._deadline:
                return (Send(self.cycle),)
            return self._end(
                f'cycle {self.cycle} did not start within {self._start_timeout} s; {listeners}: '
                f'are inverse_kinematics, joint_controllers and machine running?'
            )
        if self.is_on_machine and machine_ended:
            reason = 'the machine that ran it is gone: its process has ended or cannot be reached; start it again'
            ended = self._end(f'cycle {self.cycle}: {reason}') if self.state is GoalState.RUNNING else ()
            self.state = GoalState.ENDED
            return StopCycle(self.cycle, reason), *ended
        if self.state is GoalState.AWAITING_METRICS and now > self._deadline:
            return self._end('')
        return ()

    def _end_if_complete(self, expected):
        return self._end('') if self._errors.keys() >= set(expected) else ()

    def _end(self, reason):
        self.state = GoalState.ENDED
        return (End(reason, dict(self._errors)),)
