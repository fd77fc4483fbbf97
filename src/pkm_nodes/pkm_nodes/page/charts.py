"""Charts of the page: error of the latest and of the best cycle, of the tool, convergence, motor currents."""

from itertools import cycle

import numpy as np

from pkm_core.reporting.histories import ARM

_COLOURS = ('#1f77b4', '#ff7f0e', '#2ca02c', '#d62728')
_HEIGHT = 122  # [px] five charts with titles and legends fill a window of 920 px
# points per curve; more than a chart has pixels are invisible
_POINTS = 700


class Charts:
    """Five uPlot charts and their legends in the current container of a viser GUI."""

    def __init__(self, gui, machine):
        self._joints = machine.joints
        self._sample_time = machine.sample_time
        gain = machine.config.drive.amplifier_gain
        self._colours = dict(zip(self._joints, cycle(_COLOURS), strict=False))
        gui.add_html(_legend(self._colours, 'time in ms'))
        self._error = self._add(gui)
        self._best_error = self._add(gui)
        self._convergence = self._add(gui, logarithmic=True)
        self._convergence.title = 'Largest dynamic error [um] by cycle'
        self._current = self._add(gui)
        self._of_tool = dict(zip(machine.coordinates, cycle(_COLOURS), strict=False))
        gui.add_html(_legend(self._of_tool, f'by laser, phi on {1e3 * ARM:g} mm'))
        self._tool = self._add(gui, self._of_tool)
        self._by_trace = (  # chart, words, which trace of the cell, values of a trace
            (self._error, 'Error of the latest cycle [um]', 'latest', lambda trace: 1e6 * trace.error),
            (self._best_error, 'Error of the best cycle [um]', 'best', lambda trace: 1e6 * trace.error),
            (self._current, 'Motor currents of the latest cycle [A]', 'latest', lambda trace: gain * trace.voltage),
        )
        self._shown = {}

    def show(self, cell):
        """Update the charts whose data have changed."""
        for chart, words, name, values in self._by_trace:
            trace = getattr(cell, name)
            if self._is_new(words, trace):
                chart.title = f'{words}: cycle {trace.cycle}' if trace else words
                self._show_trace(chart, values(trace) if trace else np.full((2, len(self._joints)), np.nan))
        if self._is_new('tool', cell.tool):
            self._show_tool(cell.tool)
        if self._is_new('convergence', cell.measured):
            self._show_convergence(cell.errors)

    def _is_new(self, name, what):
        new = name not in self._shown or self._shown[name] != what
        self._shown[name] = what
        return new

    def _add(self, gui, colours=None, *, logarithmic=False):
        line = {'width': 1.3, 'points': {'show': logarithmic, 'size': 5.0}}
        colours = self._colours if colours is None else colours
        series = ({}, *({'label': name, 'stroke': colour, **line} for name, colour in colours.items()))
        return gui.add_uplot(
            tuple(np.full(2, np.nan) for _ in series),
            series,
            scales={'x': {'time': False}, 'y': {'distr': 3} if logarithmic else {}},
            axes=({'size': 24.0}, {'size': 44.0}),
            legend={'show': False},
            height=_HEIGHT,
            padding=(10, 12, 0, 0),
        )

    def _show_trace(self, chart, rows):
        keep = slice(None, None, max(1, len(rows) // _POINTS))
        milliseconds = 1e3 * self._sample_time * np.arange(len(rows))
        chart.data = (milliseconds[keep], *np.ascontiguousarray(rows[keep].T))

    def _show_tool(self, trace):
        words = 'Error of the tool [um]'
        self._tool.title = f'{words}: cycle {trace.cycle}' if trace else words
        if trace is None:
            self._tool.data = tuple(np.full(2, np.nan) for _ in (0, *self._of_tool))
            return
        keep = slice(None, None, max(1, len(trace.time) // _POINTS))
        self._tool.data = (1e3 * trace.time[keep], *np.ascontiguousarray(1e6 * trace.error[keep].T))

    def _show_convergence(self, errors):
        cycles = sorted(errors) or [1]
        rows = [[1e6 * errors.get(number, {}).get(joint, np.nan) for number in cycles] for joint in self._joints]
        self._convergence.data = (np.array(cycles, dtype=float), *map(np.array, rows))


def _legend(colours, remark):
    names = ' '.join(f'<b style="color:{colour}">&#9632; {name}</b>' for name, colour in colours.items())
    return f'<div style="font-size:12px;padding:2px 14px">{names}, {remark}</div>'
