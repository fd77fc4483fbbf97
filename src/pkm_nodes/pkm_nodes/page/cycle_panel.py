"""The right panel: curves of one cycle with its choice, the learning of the motion, and the cycles of the session."""

from time import monotonic

from pkm_nodes.page.charts import CycleCharts, LearningCharts
from pkm_nodes.page.panels import history_html, learned_html, shown_html

_LATEST = 'latest'
_PERIOD = 0.5  # [s] between two updates of the list of cycles
_LISTED = 200  # cycles in the list


class CyclePanel:
    """Tabs of a viser panel; `wish('show', cycle)` chooses the cycle, 0 for the latest."""

    def __init__(self, gui, panel, machine, wish):
        with panel.add_tab('Cycle'):
            self._list = gui.add_dropdown('show cycle', [_LATEST])
            self._list.on_update(lambda event: event.client and wish('show', _number(self._list.value)))
            self._shown = gui.add_html('')
            self._charts = CycleCharts(gui, machine)
        with panel.add_tab('Learning'):
            self._learned = gui.add_html('')
            self._learning = LearningCharts(gui, machine)
            self._history = gui.add_html('')
        self._seen, self._next = None, 0.0

    def show(self, cell):
        """Update what has changed in `cell`."""
        self._charts.show(cell.shown)
        self._learning.show(cell)
        for element, text in ((self._shown, shown_html(cell)), (self._learned, learned_html(cell))):
            if element.content != text:
                element.content = text
        state = (id(cell.history), cell.history.changes, cell.chosen)
        if state != self._seen and monotonic() >= self._next:
            self._seen, self._next = state, monotonic() + _PERIOD
            self._list_cycles(cell)

    def _list_cycles(self, cell):
        listed = [past for past in list(cell.history)[:_LISTED] if past.bag or past.missing]
        lines = {0: _LATEST} | {past.cycle: past.line for past in listed}
        self._list.options = list(lines.values())
        self._list.value = lines.get(cell.chosen, _LATEST)
        self._history.content = history_html(cell)


def _number(line):
    return 0 if line == _LATEST else int(line.split(':')[0])
