"""Charts of the page: curves of one cycle, and the convergence of the current motion. Each title names its data."""

from itertools import cycle

import numpy as np

from pkm_core.reporting.histories import ARM

_COLOURS = ('#1f77b4', '#ff7f0e', '#2ca02c', '#e0424e')
_HEIGHT = 130  # [px] four charts with titles and legends fill a window of 900 px
# points per curve; more than a chart has pixels are invisible
_POINTS = 700
_WHOLE = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0]  # steps of an axis of cycles


class _Chart:
    """A uPlot chart in the current container of a viser GUI; `colours` by name of its curves."""

    def __init__(self, gui, colours, *, by_cycle=False):
        line = {'width': 1.3, 'points': {'show': by_cycle, 'size': 5.0}}
        series = ({}, *({'label': name, 'stroke': colour, **line} for name, colour in colours.items()))
        # viser keeps the shown part of x relative to the data before; without a range it would keep none
        self._empty = (np.array([0.0, 1.0]), *(np.full(2, np.nan) for _ in colours))
        axis_of_cycles = {'incrs': _WHOLE} if by_cycle else {}
        ticks = {'show': False}
        self._plot = gui.add_uplot(
            self._empty,
            series,
            scales={'x': {'time': False}, 'y': {'distr': 3} if by_cycle else {}},
            axes=(
                {'size': 22.0, 'ticks': ticks, **axis_of_cycles},
                {'size': 44.0, 'space': 24.0, 'ticks': ticks, 'grid': {'show': not by_cycle}},
            ),
            legend={'show': False},
            height=_HEIGHT,
            padding=(8, 12, 0, 0),
        )

    def draw(self, title, x=None, rows=None):
        """Draw the columns of `rows` (N, n) over `x` (N,), or nothing."""
        if x is None or len(x) == 0:
            data = self._empty
        else:
            keep = slice(None, None, max(1, len(x) // _POINTS))
            data = (x[keep], *np.ascontiguousarray(rows[keep].T))
        self._plot.title, self._plot.data = title, tuple(each.astype(float) for each in data)


class CycleCharts:
    """Error of the joints, error of the tool by laser, currents and their learned part over one cycle."""

    def __init__(self, gui, machine):
        self._sample_time = machine.sample_time
        self._gain = machine.config.drive.amplifier_gain
        of_joints, of_tool = _colours(machine.joints), _colours(machine.coordinates)
        gui.add_html(_legend(of_joints, 'over time in ms'))
        self._error = _Chart(gui, of_joints)
        self._current, self._learned = _Chart(gui, of_joints), _Chart(gui, of_joints)
        gui.add_html(_legend(of_tool, f'phi on {1e3 * ARM:g} mm' if 'phi' in of_tool else ''))
        self._tool = _Chart(gui, of_tool)
        self._drawn = False  # None is a trace too

    def show(self, trace):
        """Draw a `Trace`, or nothing for None."""
        if trace is self._drawn:
            return
        self._drawn = trace
        if trace is None:
            for chart, words in (
                (self._error, 'Error [um]'),
                (self._current, 'Motor current [A]'),
                (self._learned, 'Learned part of the current [A]'),
                (self._tool, 'Error of the tool by laser [um]'),
            ):
                chart.draw(words)
            return
        of = f'cycle {trace.cycle}'
        time = 1e3 * self._sample_time * np.arange(len(trace.error))
        self._error.draw(f'Error [um]: {of}', time, 1e6 * trace.error)
        self._current.draw(f'Motor current [A]: {of}', time, self._gain * trace.voltage)
        none = '' if trace.feedforward.any() else ', none'
        self._learned.draw(f'Learned part of the current [A]: {of}{none}', time, self._gain * trace.feedforward)
        if trace.tool is None:
            self._tool.draw('Error of the tool: no laser')
        else:
            self._tool.draw(f'Error of the tool by laser [um]: {of}', 1e3 * trace.tool.time, 1e6 * trace.tool.error)


class LearningCharts:
    """Convergence over the cycles of the current motion, and the error of the best of them."""

    def __init__(self, gui, machine):
        self._joints, self._sample_time = machine.joints, machine.sample_time
        colours = _colours(machine.joints)
        gui.add_html(_legend(colours, 'by cycle'))
        self._convergence = _Chart(gui, colours, by_cycle=True)
        gui.add_html(_legend(colours, 'over time in ms'))
        self._best = _Chart(gui, colours)
        self._drawn = None

    def show(self, cell):
        """Draw what has changed in `cell`."""
        state = (cell.measured, cell.best)
        if state == self._drawn:
            return
        self._drawn = state
        cycles = sorted(cell.errors)
        rows = [[1e6 * cell.errors[number].get(joint, np.nan) for joint in self._joints] for number in cycles]
        self._convergence.draw('Largest dynamic error [um]', np.array(cycles, dtype=float), np.array(rows))
        if cell.best is None:
            self._best.draw('Error of the best cycle [um]')
        else:
            time = 1e3 * self._sample_time * np.arange(len(cell.best.error))
            self._best.draw(f'Error of the best cycle [um]: cycle {cell.best.cycle}', time, 1e6 * cell.best.error)


def _colours(names):
    return dict(zip(names, cycle(_COLOURS), strict=False))


def _legend(colours, remark):
    names = ' '.join(f'<b style="color:{colour}">&#9632;&nbsp;{name}</b>' for name, colour in colours.items())
    return f'<div class="pkm">{names}{f", {remark}" if remark else ""}</div>'
