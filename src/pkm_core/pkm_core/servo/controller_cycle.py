"""State machine of a controller between trajectories: which cycle waits, is loaded, or runs. No ROS, no clock."""

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Any

NO_CYCLE = -1  # no message has this number: cycles are unsigned


class ControllerState(StrEnum):
    """State of a controller; also the value of the key `state` in its diagnostics."""

    STANDING = 'standing'  # no trajectory
    WAITING = 'waiting'  # a trajectory is here, something else is missing
    LOADED = 'loaded'  # the first tick is answered
    RUNNING = 'running'  # at least one tick has been answered


class Action(Enum):
    """Reaction to a trajectory."""

    ACCEPT = 'check it, then `wait_for`'
    REPORT = 'report the loaded cycle again'
    REFUSE = 'another cycle is running'


@dataclass(frozen=True)
class Waiting:
    """A cycle that is not loaded yet."""

    cycle: int
    content: Any  # of the caller
    deadline: float  # [s] until then every known reader of the commands must be connected, later one reader is enough


class ControllerCycle:
    """
    Which cycle a controller drives.

    Parameters
    ----------
    discovery : float
        [s] time that known readers of the commands have to connect before a cycle is loaded without them.

    Attributes
    ----------
    active : int
        Number of the loaded or running cycle, `NO_CYCLE` if none. A sample of any other cycle gets no command: one
        comparison on the tick path.
    running : bool
        Set by the caller with the first command of the active cycle.
    last : int
        Number of the cycle that was loaded last, 0 before the first.

    """

    def __init__(self, discovery):
        self._discovery = discovery
        self.active, self.running, self.last = NO_CYCLE, False, 0
        self._waiting: Any = None  # Waiting

    @property
    def state(self):
        """The `ControllerState`."""
        if self.running:
            return ControllerState.RUNNING
        if self.active != NO_CYCLE:
            return ControllerState.LOADED
        return ControllerState.STANDING if self._waiting is None else ControllerState.WAITING

    @property
    def waiting(self):
        """The content of the cycle that waits, or None."""
        return None if self._waiting is None else self._waiting.content

    def on_trajectory(self, cycle):
        """Return the `Action` on a trajectory of `cycle`; the state does not change."""
        if cycle == self.active:
            return Action.REPORT
        return Action.REFUSE if self.running else Action.ACCEPT

    def wait_for(self, cycle, content, now):
        """Take the accepted trajectory of `cycle`, at `now` [s]; it replaces a waiting or loaded one."""
        again = self._waiting is not None and self._waiting.cycle == cycle
        deadline = self._waiting.deadline if again else now + self._discovery
        self._waiting, self.active = Waiting(cycle, content, deadline), NO_CYCLE

    def is_connected(self, known, connected, now):
        """
        Return whether enough readers of a command topic are connected to load the waiting cycle.

        Parameters
        ----------
        known, connected : int
            Readers that the graph lists, and those that are connected.
        now : float
            [s]

        """
        return connected >= (max(1, known) if now < self._waiting.deadline else 1)

    def begin(self):
        """Take the waiting cycle and return its content; `loaded` follows unless the law refuses it."""
        waiting, self._waiting = self._waiting, None
        self.last = waiting.cycle
        return waiting.content

    def loaded(self):
        """Note that the law has taken the cycle of `begin`."""
        self.active = self.last

    def is_stopped_by(self, cycle):
        """Return whether a STOP event of `cycle` means the running cycle."""
        return self.running and cycle == self.active

    def end(self):
        """Drop the active cycle: it has finished, was stopped, or the machine was reset. A waiting one stays."""
        self.active, self.running = NO_CYCLE, False
