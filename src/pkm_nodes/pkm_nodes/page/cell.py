"""State of a running cell as its messages describe it; plain data, no ROS calls and no drawing."""

from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, isfinite, nan

import numpy as np

from pkm_core.errors import BagError
from pkm_core.machines.description import joint_positions
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.page.tool_trace import ToolTrace, tool_trace
from pkm_nodes.page.trace import Trace, read_trace

# [cycles] number of cycles kept
_MEMORY = 500


def home_pose(machine):
    """Return {coordinate: value [m, rad]} of `machine` at home."""
    return dict(zip(machine.coordinates, machine.forward(machine.home).tolist(), strict=True))


class Status(StrEnum):
    """State of the machine on the page."""

    AWAY = 'no cell'
    STANDING = 'standing'
    RUNNING = 'running'
    FAULT = 'fault'


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


@dataclass(eq=False)
class Cell:
    """State of the cell around `machine`; errors and traces belong to the current motion and law."""

    machine: object = None
    namespace: str = '/pkm'
    status: Status = Status.AWAY
    reason: str = ''  # of a fault
    positions: dict = field(default_factory=dict)  # motors and passive joints [m, rad]
    pose: dict = field(default_factory=dict)  # by coordinate [m, rad]
    ticks_per_second: float = 0.0
    cycle: int = 0
    motion: str = ''
    law: str = ''
    path: np.ndarray | None = None  # (N, 3) planned positions of the tool [m]
    errors: dict = field(default_factory=dict)  # {cycle: {joint: largest dynamic error [m]}}
    best_cycle: int = 0  # the one with the smallest error of its worst axis; 0 if none is known
    measured: int = 0  # counter, changes with `errors`
    latest: Trace | None = None
    best: Trace | None = None
    tool: ToolTrace | None = None  # of the latest cycle
    no_trace: str = ''  # why there is no latest trace
    nodes: list = field(default_factory=list)
    notice: Notice = field(default_factory=Notice)
    _poses: np.ndarray | None = None  # (N, m) planned poses [m, rad]
    _reference: bytes = b''

    def __post_init__(self):
        if self.machine is not None:
            self._stand_at_home()

    def leave(self):
        """Note that the cell has left the graph; its last picture stays."""
        self.status, self.reason, self.ticks_per_second = Status.AWAY, '', 0.0

    def begin_anew(self):
        """Note that the machine was restarted: its cycles count from 1 and nothing is learned."""
        self.cycle = 0
        self._forget(before=inf)

    def load(self, cycle, motion, law, poses):
        """Take the pose trajectory (N, m) of `cycle`; with another motion or law, errors and traces are dropped."""
        reference = poses.tobytes()
        if (motion, law, reference) == (self.motion, self.law, self._reference):
            return
        self.motion, self.law, self._reference = motion, law, reference
        self._forget(before=cycle)
        self._poses, self.path = poses, np.zeros((len(poses), 3))
        for name, column in zip(self.machine.coordinates, poses.T, strict=True):
            if name in 'xyz':
                self.path[:, 'xyz'.index(name)] = column

    def hear(self, event):
        """Take a CycleEvent."""
        if event.event == CycleEvent.STARTED:
            self.cycle, self.status, self.reason = event.cycle, Status.RUNNING, ''
        elif event.event == CycleEvent.FINISHED:
            self.status = Status.STANDING
        elif event.event == CycleEvent.FAULT:
            self.status, self.reason = Status.FAULT, event.message
        elif event.event == CycleEvent.RESET:
            self.status, self.reason = Status.STANDING, ''
            self._stand_at_home()
        elif event.event == CycleEvent.REFUSED:
            self.notice = Notice(f'{event.source}: {event.message}', good=False)
        elif event.event == CycleEvent.NOT_RECORDED:
            self.no_trace = f'cycle {event.cycle} is not recorded: {event.message}'
        elif event.event == CycleEvent.RECORDED:
            self._read(event.cycle, event.bag)

    def measure(self, metrics):
        """Take the CycleMetrics of one joint."""
        self.measured += 1
        self.errors.setdefault(metrics.cycle, {})[metrics.joint] = metrics.max_dynamic_error
        if self.worst(metrics.cycle) < (self.worst(self.best_cycle) if self.best_cycle else inf):
            self.best_cycle = metrics.cycle
            self._keep_best()
        if len(self.errors) > _MEMORY:
            del self.errors[min(self.errors.keys() - {self.best_cycle})]

    def worst(self, cycle):
        """Return the error of the worst axis of `cycle` [m], nan while metrics of a joint are missing."""
        errors = self.errors.get(cycle, {})
        return max(errors.values()) if len(errors) == len(self.machine.joints) else nan

    def _read(self, cycle, path):
        try:
            self.latest = read_trace(path, cycle, self.machine.joints, self.namespace)
        except BagError as error:
            self.no_trace = str(error)
            return
        self.no_trace = ''
        self.tool = tool_trace(self.latest, self._poses, self.machine)
        self._keep_best()

    def _keep_best(self):
        """Keep the trace of the best cycle; metrics and bag of a cycle arrive in any order."""
        if self.latest is not None and self.latest.cycle == self.best_cycle:
            self.best = self.latest

    def _stand_at_home(self):
        self.positions = joint_positions(self.machine, self.machine.home)
        self.pose = home_pose(self.machine)

    def _forget(self, before):
        """Forget all cycles before `before`; messages of later ones may have arrived already."""
        self.measured += 1
        self.errors = {cycle: errors for cycle, errors in self.errors.items() if cycle >= before}
        known = [(self.worst(cycle), cycle) for cycle in self.errors if isfinite(self.worst(cycle))]
        self.best_cycle = min(known)[1] if known else 0
        self.latest, self.best = (
            trace if trace is not None and trace.cycle >= before else None for trace in (self.latest, self.best)
        )
        self._keep_best()
        if self.latest is None:
            self.tool = None
