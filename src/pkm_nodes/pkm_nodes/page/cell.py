"""State of a running cell as its messages describe it; plain data, no ROS calls and no drawing."""

from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, isfinite, nan

import numpy as np

from pkm_core.errors import BagError
from pkm_core.machines.description import joint_positions
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.page.history import MEMORY, History
from pkm_nodes.page.trace import Trace, read_trace


def home_pose(machine):
    """Return {coordinate: value [m, rad]} of `machine` at home."""
    return dict(zip(machine.coordinates, machine.forward(machine.home).tolist(), strict=True))


class Status(StrEnum):
    """State of the machine on the page."""

    AWAY = 'no cell'
    STANDING = 'standing'
    RUNNING = 'running'
    FAULT = 'fault'
    PLAYED = 'bag'


@dataclass
class Notice:
    """Answer of the cell to a button."""

    text: str = ''
    good: bool = True


@dataclass
class NodeLine:
    """One row of the table of nodes."""

    name: str
    good: bool
    text: str


@dataclass
class Pace:
    """Ratio of simulated to wall time, as the machine reports it in its diagnostics."""

    offered: bool = False  # the machine has the parameter `pace` and the services pause and step
    asked: float = 0.0  # 0 is as fast as possible
    reached: float = nan
    paused: bool = False


@dataclass(eq=False)
class Cell:
    """State of the cell around `machine`; errors belong to the current motion and law, curves to their own bag."""

    machine: object = None
    namespace: str = '/pkm'
    domain: int = 0
    status: Status = Status.AWAY
    reason: str = ''  # of a fault
    positions: dict = field(default_factory=dict)  # motors and passive joints [m, rad]
    pose: dict = field(default_factory=dict)  # by coordinate [m, rad]
    ticks_per_second: float = 0.0
    pace: Pace = field(default_factory=Pace)
    geometry: str = ''  # the lengths in use, in words
    cycle: int = 0
    motion: str = ''
    law: str = ''
    path: np.ndarray | None = None  # (N, 3) planned positions of the tool [m]
    errors: dict = field(default_factory=dict)  # {cycle: {joint: largest dynamic error [m]}}
    best_cycle: int = 0  # the one with the smallest error of its worst axis; 0 if none is known
    measured: int = 0  # counter, changes with `errors`
    history: History = field(default_factory=History)
    chosen: int = 0  # cycle of the history to show; 0 is the latest
    shown: Trace | None = None
    best: Trace | None = None
    no_trace: str = ''  # why there are no curves of the wanted cycle
    nodes: list = field(default_factory=list)
    notice: Notice = field(default_factory=Notice)
    player: object = None  # of a recorded bag, see player.py; None for a running cell
    is_replayed: bool = False  # `pkm bag-play` publishes in the namespace of the cell
    _recorded: int = 0  # latest cycle with a bag
    _tried: dict = field(default_factory=dict)  # {'shown' or 'best': bag that was read last}
    _reference: bytes = b''

    def __post_init__(self):
        if self.machine is not None:
            self._stand_at_home()

    def leave(self):
        """Note that the cell has left the graph; its last picture stays."""
        self.status, self.reason, self.ticks_per_second, self.pace = Status.AWAY, '', 0.0, Pace()

    def begin_anew(self):
        """Note that the machine was restarted: its cycles count from 1, nothing is learned, nothing seen is valid."""
        self.cycle = self.chosen = 0
        self.history, self.motion, self.law, self.path, self._reference = History(), '', '', None, b''
        self._forget(before=inf)

    def load(self, cycle, motion, law, poses):
        """Take the pose trajectory (N, m) of `cycle`; with another motion or law, errors and curves are dropped."""
        self.history.note(cycle, motion=motion, law=law)
        reference = poses.tobytes()
        if (motion, law, reference) == (self.motion, self.law, self._reference):
            return
        self.motion, self.law, self._reference = motion, law, reference
        self._forget(before=cycle)
        self.path = np.zeros((len(poses), 3))
        for name, column in zip(self.machine.coordinates, poses.T, strict=True):
            if name in 'xyz':
                self.path[:, 'xyz'.index(name)] = column

    def hear(self, event):
        """Take a CycleEvent."""
        if event.event == CycleEvent.STARTED:
            self.cycle, self.status, self.reason = event.cycle, Status.RUNNING, ''
            self.history.note(event.cycle, motion=self.motion, law=self.law)
        elif event.event == CycleEvent.FINISHED:
            self.status = Status.STANDING
        elif event.event == CycleEvent.FAULT:
            self.status, self.reason = Status.FAULT, event.message
            if self.history.get(event.cycle):
                self.history.note(event.cycle, fault=event.message)
        elif event.event == CycleEvent.RESET:
            self.status, self.reason = Status.STANDING, ''
            self._stand_at_home()
        elif event.event == CycleEvent.REFUSED:
            self.notice = Notice(f'{event.source}: {event.message}', good=False)
        elif event.event == CycleEvent.NOT_RECORDED:
            self.no_trace = f'cycle {event.cycle} is not recorded: {event.message}'
            self.history.note(event.cycle, missing=event.message)
        elif event.event == CycleEvent.RECORDED:
            self._recorded = max(self._recorded, event.cycle)
            self.history.note(event.cycle, bag=event.bag)

    def measure(self, metrics):
        """Take the CycleMetrics of one joint."""
        self.measured += 1
        self.errors.setdefault(metrics.cycle, {})[metrics.joint] = metrics.max_dynamic_error
        worst = self.worst(metrics.cycle)
        if isfinite(worst):
            self.history.note(metrics.cycle, worst=worst)
        if worst < (self.worst(self.best_cycle) if self.best_cycle else inf):
            self.best_cycle = metrics.cycle
        if len(self.errors) > MEMORY:
            del self.errors[min(self.errors.keys() - {self.best_cycle})]

    def worst(self, cycle):
        """Return the error of the worst axis of `cycle` [m], nan while metrics of a joint are missing."""
        errors = self.errors.get(cycle, {})
        return max(errors.values()) if len(errors) == len(self.machine.joints) else nan

    def refresh(self):
        """Read the curves of the chosen or latest cycle and of the best one, unless they are shown already."""
        self.shown = self._curves('shown', self.chosen or self._recorded, self.shown)
        self.best = self._curves('best', self.best_cycle, self.best)

    def _curves(self, role, cycle, present):
        """Return the `Trace` of `cycle`; `present` until its bag is recorded."""
        past = self.history.get(cycle)
        if past is None or self._tried.get(role) == past.bag:
            return present
        if not past.bag:  # it may still come
            if role == 'shown' and self.chosen:
                self.no_trace = past.missing and f'cycle {cycle} is not recorded: {past.missing}'
            return None if past.missing or self.chosen else present
        self._tried[role] = past.bag
        if self.shown is not None and self._tried.get('shown') == past.bag and role == 'best':
            return self.shown
        try:
            trace = read_trace(past.bag, cycle, self.machine, self.namespace)
        except BagError as error:
            if role == 'shown':
                self.no_trace = str(error)
            return None
        if role == 'shown':
            self.no_trace = ''
        return trace

    def _stand_at_home(self):
        self.positions = joint_positions(self.machine, self.machine.home)
        self.pose = home_pose(self.machine)

    def _forget(self, before):
        """Forget all errors and curves before cycle `before`; messages of later ones may have arrived already."""
        self.measured += 1
        self.errors = {cycle: errors for cycle, errors in self.errors.items() if cycle >= before}
        known = [(self.worst(cycle), cycle) for cycle in self.errors if isfinite(self.worst(cycle))]
        self.best_cycle = min(known)[1] if known else 0
        self.chosen = 0
        self.shown, self.best = (
            trace if trace is not None and trace.cycle >= before else None for trace in (self.shown, self.best)
        )
        if self._recorded < before:
            self._recorded = 0
        self._tried = {}
