"""One motion cycle as arrays, simulated or out of a bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pkm_core.api.drawing import empty_figure
from pkm_core.api.typing import Array, IntArray
from pkm_core.bag import cycle_record
from pkm_core.errors import BagError
from pkm_core.motion.metrics import AxisMetrics, axis_metrics

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGNALS = {'position': 'm', 'reference': 'm', 'error': 'm', 'voltage': 'V', 'feedforward': 'V'}


@dataclass(frozen=True, repr=False, eq=False)
class Cycle:
    """
    One motion cycle: arrays of shape (N, n), one row per sample, one column per joint.

    Attributes
    ----------
    motion, law : str
        Names of the motion and of the learning law.
    number : int
        Of the cycle, from 1.
    joints, coordinates : tuple of str
        Names of the columns, and those of `laser`.
    sample_time : float
        [s]
    samples : int
        Of the whole cycle; N is less if the cycle ended in a safe stop.
    position, reference, error : ndarray, shape (N, n)
        Measured position, its reference, and reference minus position [m].
    counts : ndarray of int64, shape (N, n)
        Encoder readings.
    voltage, feedforward : ndarray, shape (N, n)
        Voltage sent to the drives and the learned part of it, before the filters [V].
    move_starts, move_ends : ndarray of int, shape (moves,)
        First sample of each move, and the sample at which its profile has ended.
    laser_time, laser : ndarray, shape (K,) and (K, m)
        End-point measurements: time from the first sample [s], displacement in `coordinates` [m, rad]; K is 0 without.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> cycle = pkm.simulate(pkm.load_machine('xy_stage')).cycle(1)
    >>> cycle
    Cycle(1 of xy_stage_100ms, law none: 800 samples of 2 joints, largest error in motion x 4.7 um, y 19.8 um)
    >>> cycle.position.shape, list(cycle.columns())[:3]
    ((800, 2), ['time [s]', 'x position [m]', 'x reference [m]'])

    """

    motion: str
    law: str
    number: int
    joints: tuple[str, ...]
    coordinates: tuple[str, ...]
    sample_time: float
    samples: int
    position: Array
    reference: Array
    error: Array
    counts: IntArray
    voltage: Array
    feedforward: Array
    move_starts: IntArray
    move_ends: IntArray
    laser_time: Array
    laser: Array

    def __len__(self) -> int:
        return len(self.position)

    def __repr__(self) -> str:
        head = f'Cycle({self.number} of {self.motion}, law {self.law}: '
        if not self.is_whole:
            return f'{head}{len(self)} of {self.samples} samples of {len(self.joints)} joints)'
        errors = ', '.join(f'{joint} {1e6 * each.max_dynamic_error:.1f} um' for joint, each in self.metrics().items())
        return f'{head}{len(self)} samples of {len(self.joints)} joints, largest error in motion {errors})'

    @property
    def is_whole(self) -> bool:
        """Whether the cycle was driven to its end."""
        return len(self) == self.samples

    @property
    def time(self) -> Array:
        """Time of the samples from the start of the cycle, shape (N,) [s]."""
        return np.arange(len(self), dtype=np.float64) * self.sample_time

    def metrics(self) -> dict[str, AxisMetrics]:
        """
        Return {joint: AxisMetrics}: `max_dynamic_error` [m], `settling_time_5um`, `settling_time_1um` [s],
        `steady_state_error` [m]; each the worst of all moves, after the thesis's tables 7.2 and 8.2.

        Raises
        ------
        BagError
            If the cycle ended in a safe stop.

        """
        if not self.is_whole:
            raise BagError(f'cycle {self.number}: has {len(self)} of {self.samples} samples; metrics need all')
        return {
            joint: axis_metrics(error, self.move_starts, self.move_ends, self.sample_time)
            for joint, error in zip(self.joints, self.error.T, strict=True)
        }

    def columns(self) -> dict[str, Array]:
        """Return {'JOINT SIGNAL [UNIT]': (N,)} with the time first, for ``pandas.DataFrame(cycle.columns())``."""
        found = {'time [s]': self.time}
        for column, joint in enumerate(self.joints):
            for name, unit in SIGNALS.items():
                found[f'{joint} {name} [{unit}]'] = getattr(self, name)[:, column]
        return found

    def plot(self) -> Figure:
        """Return a figure of displacement, error and voltage of every joint; moves have a grey background."""
        figure = empty_figure(9.0, 7.0)
        panels = figure.subplots(3, 1, sharex=True)
        rows = (1e3 * (self.position - self.position[:1]), 1e6 * self.error, self.voltage)
        labels = ('displacement [mm]', 'error [um]', 'voltage [V]')
        time = 1e3 * self.time
        for axes, values, label in zip(panels, rows, labels, strict=True):
            for start, end in zip(self.move_starts, self.move_ends, strict=True):
                axes.axvspan(1e3 * self.sample_time * start, 1e3 * self.sample_time * end, color='0.93')
            for column, joint in enumerate(self.joints):
                axes.plot(time, values[:, column], label=joint, linewidth=1)
            axes.set(ylabel=label)
            axes.grid(alpha=0.3)
        panels[0].set(title=f'{self.motion}, cycle {self.number}, learning law {self.law}')
        panels[0].legend(ncols=len(self.joints))
        panels[-1].set(xlabel='time [ms]')
        return figure


def read_cycle(bag: str | Path, namespace: str | None = None) -> Cycle:
    """
    Return the cycle that the bag folder `bag` holds.

    Parameters
    ----------
    bag : str or Path
        Folder of a bag that the recorder of the cell wrote, e.g. runs/first/four_dof_70ms_0001_20261128T190834.
    namespace : str, optional
        Of the cell that was recorded, e.g. '/pkm'; by default the only one in the bag.

    Raises
    ------
    BagError
        If there is no such bag, it is damaged or has a gap, or holds cells of several namespaces.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> pkm.read_cycle('runs/missing')  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    pkm_core.errors.BagError: runs/missing/metadata.yaml: cannot be read as the metadata of a bag: ...

    """
    record = cycle_record.read_cycle(bag, namespace)
    return Cycle(
        motion=record.motion,
        law=record.learning_law,
        number=record.cycle,
        **{
            name: getattr(record, name)
            for name in Cycle.__dataclass_fields__
            if name not in ('motion', 'law', 'number')
        },
    )
