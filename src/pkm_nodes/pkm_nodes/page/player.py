"""
Plays the cycles of recorded bags on the page: any pace, pause, scrub. It reads the files and needs no ROS graph.

A bag is read directly instead of over DDS: every instant can be shown at once, nothing can be lost, and no message
that looks like one of a running cell gets into a graph.
"""

from pathlib import Path
from time import monotonic

import numpy as np

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import read_metadata, read_topics
from pkm_core.errors import BagError, PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.description import joint_positions
from pkm_nodes.page.cell import Cell, Status
from pkm_nodes.page.history import MEMORY

_END = '/joint_trajectory'  # of the topic by which the namespace of a cell is known


class Player:
    """
    Plays the bags in a folder.

    Parameters
    ----------
    path : Path
        A bag, or a folder of bags, or the folder of a run.
    clock : callable
        Returns the wall time [s].

    Attributes
    ----------
    cell : Cell
        What the page shows.
    time : float
        [s] since the start of the cycle.
    duration : float
        [s] of the recorded part of the cycle.
    pace : float
        Simulated time per wall time.
    is_playing : bool

    Raises
    ------
    PkmError
        If there is no bag of a cell, or its machine is unknown.

    """

    def __init__(self, path, clock=monotonic):
        self._clock = clock
        self._bags, left_out = _bags_in(Path(path))
        namespace, facts = _origin(next(iter(self._bags.values())))
        machine = load_machine(facts.get('machine', ''))
        self.cell = Cell(machine, namespace, status=Status.PLAYED, player=self)
        self.time, self.pace, self.is_playing = 0.0, 1.0, True
        self._record, self._at = None, clock()
        self._errors = {}  # {cycle: {joint: largest dynamic error [m]}}
        self._plans = {}  # {cycle: (motion, law)}
        self._due = sorted(self._bags)  # cycles whose figures are not read yet
        if left_out:
            self.cell.notice.text = f'{left_out} older bags with the same cycle numbers are left out'
        self.choose(max(self._bags))

    @property
    def duration(self):
        """[s] of the recorded part of the cycle."""
        return 0.0 if self._record is None else (len(self._record.ticks) - 1) * self._record.sample_time

    @property
    def error(self):
        """Error of the joints now, {joint: [m]}; {} without a record."""
        if self._record is None:
            return {}
        return dict(zip(self._record.joints, self._record.error[self._row()].tolist(), strict=True))

    def fulfil(self, wish):
        """Execute ('play',), ('pace', factor), ('seek', time [s]), ('tick', count) or ('show', cycle)."""
        name, *arguments = wish
        if name == 'play':
            self.is_playing = not self.is_playing
            if self.is_playing and self.time >= self.duration:
                self.time = 0.0
        elif name == 'pace':
            self.pace = arguments[0]
        elif name in ('seek', 'tick'):
            self.is_playing = False
            step = self.cell.machine.sample_time
            time = arguments[0] if name == 'seek' else (self._row() + arguments[0]) * step
            self.time = min(max(time, 0.0), self.duration)
        elif name == 'show':
            self.choose(arguments[0] or max(self._bags))

    def choose(self, cycle):
        """Play `cycle` from its start; a damaged bag is reported on the page."""
        cell = self.cell
        cell.chosen = cell.cycle = cycle
        self.time, self._record = 0.0, None
        if cycle in self._due:
            self._note(cycle)
        self._compare(*self._plans[cycle])
        cell.refresh()
        try:
            self._record = _checked(read_cycle(self._bags[cycle], cell.namespace), cell.machine)
        except BagError as error:
            cell.no_trace = str(error)
            return
        cell.path = _path(self._record)

    def advance(self):
        """Move the machine to the present time of the player; read the figures of one more cycle."""
        if self._due:
            self._note(self._due[-1])
            self._compare(self.cell.motion, self.cell.law)
            self.cell.refresh()
        now = self._clock()
        if self.is_playing:
            self.time += (now - self._at) * self.pace
            if self.time >= self.duration:
                self.time, self.is_playing = self.duration, False
        self._at = now
        if self._record is None:
            return
        row = self._row()
        machine, q = self.cell.machine, self._record.position[row]
        try:
            self.cell.positions = joint_positions(machine, q)
            self.cell.pose = dict(zip(machine.coordinates, machine.forward(q).tolist(), strict=True))
        except PkmError as error:
            self.cell.no_trace = str(error)

    def _row(self):
        """Return the row of the record at the present time."""
        return min(round(self.time / self.cell.machine.sample_time), len(self._record.ticks) - 1)

    def _compare(self, motion, law):
        """Show the convergence of the cycles of one motion and law."""
        cell = self.cell
        cell.motion, cell.law = motion, law
        same = [cycle for cycle in self._errors if self._plans[cycle] == (motion, law)]
        cell.errors = {cycle: self._errors[cycle] for cycle in sorted(same)}
        cell.best_cycle = min(same, key=cell.worst, default=0)
        cell.measured += 1

    def _note(self, cycle):
        """Enter a bag into the history."""
        cell, bag = self.cell, self._bags[cycle]
        self._due.remove(cycle)
        self._plans[cycle] = '', ''
        topics = {f'{cell.namespace}/{joint}/cycle_metrics': joint for joint in cell.machine.joints}
        try:
            facts = read_metadata(bag).get('custom_data') or {}
            messages = read_topics(bag, topics)
        except BagError as error:
            cell.history.note(cycle, missing=str(error))
            return
        found = {joint: messages[topic][-1].max_dynamic_error for topic, joint in topics.items() if messages[topic]}
        self._plans[cycle] = motion, law = facts.get('motion', ''), facts.get('learning_law', '')
        end = facts.get('end', '')
        cell.history.note(cycle, motion=motion, law=law, bag=str(bag), fault='' if end in ('finished', '') else end)
        if len(found) == len(topics):
            self._errors[cycle] = found
            cell.history.note(cycle, worst=max(found.values()))


def _bags_in(path):
    """Return {cycle: bag} of the bags at `path`, the last `MEMORY`, and the number of bags left out."""
    if not path.exists():
        raise PkmError(f'{path}: no such bag or folder')
    if path.is_file():
        path = path.parent
    files = [*path.glob('*.mcap'), *path.glob('*/*.mcap'), *path.glob('bags/*/*.mcap')]
    bags = sorted({file.parent for file in files}, key=lambda bag: (bag.stat().st_mtime, bag.name))
    if not bags:
        raise PkmError(f'{path}: has no bag; expected a bag, or a folder of bags such as that of pkm run --out')
    found, reasons = {}, []
    for bag in bags[-MEMORY:]:
        try:
            found[int((read_metadata(bag).get('custom_data') or {}).get('cycle', 0))] = bag
        except (BagError, ValueError) as error:
            reasons.append(str(error))
    if not found:
        raise PkmError('; '.join(reasons[:3]))
    return found, len(bags) - len(found) - len(reasons)


def _origin(bag):
    """Return the namespace of the cell in a bag, and the facts of the recorder."""
    info = read_metadata(bag)
    names = [each['topic_metadata']['name'] for each in info['topics_with_message_count']]
    found = [name.removesuffix(_END) for name in names if name.endswith(_END)]
    if len(found) != 1:
        raise BagError(f'{bag}: has {len(found)} topics that end in {_END}; expected a bag of one cell')
    facts = info.get('custom_data') or {}
    if not facts.get('machine'):
        raise BagError(f'{bag}: does not name its machine; expected a bag of a recorder of this project')
    return found[0], facts


def _checked(record, machine):
    """Return `record`; `BagError` unless it has samples of the joints of `machine`."""
    if record.joints != machine.joints or record.coordinates != machine.coordinates:
        raise BagError(f'{record.path}: has joints {list(record.joints)}; {machine.name} has {list(machine.joints)}')
    if not len(record.ticks):
        raise BagError(f'{record.path}: has no tick that every joint answered')
    return record


def _path(record):
    """Return the planned positions of the tool (N, 3) [m]."""
    path = np.zeros((len(record.pose_reference), 3))
    for name, column in zip(record.coordinates, record.pose_reference.T, strict=True):
        if name in 'xyz':
            path[:, 'xyz'.index(name)] = column
    return path
