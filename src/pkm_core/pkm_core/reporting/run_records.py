"""The cycles of a run of any length: figures of all of them, arrays only of the first and the last."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from pkm_core.reporting.summary import counts_by_topic, cycle_figures
from pkm_core.reporting.tool import tool_figures


@dataclass(frozen=True)
class CycleSummary:
    """What is kept of a `CycleRecord` between the first and the last one."""

    cycle: int
    axes: list  # of `AxisMetrics`, one per joint

    def metrics(self):
        """Return one `AxisMetrics` per joint, as `CycleRecord` does."""
        return self.axes


class RunRecords(Sequence):
    """
    The whole cycles of a run in order: `CycleRecord`s first and last, `CycleSummary`s between them.

    Parameters
    ----------
    records : iterable of CycleRecord
        Read one by one, so that a long run needs little memory.

    Attributes
    ----------
    rows : list of dict
        Of each cycle: number `cycle`, name of its `bag`, figures of its `axes` and of its `tool`.
    messages : dict
        {topic: {'recorded': m, 'expected': n or None}} over all cycles.
    hashes : set of str
        Hashes of the configuration in the bags.

    """

    def __init__(self, records):
        self.rows, self.hashes, self._kept = [], set(), []
        recorded, expected = Counter(), Counter()
        for record in records:
            if len(self._kept) > 1:
                self._kept[-1] = CycleSummary(self._kept[-1].cycle, self._kept[-1].metrics())
            self._kept.append(record)
            figures = {'axes': cycle_figures(record), 'tool': tool_figures(record)}
            self.rows.append({'cycle': record.cycle, 'bag': record.path.name, **figures})
            self.hashes.add(record.facts.get('config_hash', ''))
            recorded.update(record.recorded)
            expected.update(record.expected)
        self.messages = counts_by_topic(recorded, expected)

    def __len__(self):
        return len(self._kept)

    def __getitem__(self, index):
        return self._kept[index]
