"""The cycles that a page has seen since the start of its cell, each with its outcome and its bag."""

from dataclasses import dataclass
from math import nan

# [cycles] number of cycles kept
MEMORY = 500
# [characters] of a name of a motion or law in a list
_NAME = 40


@dataclass
class Past:
    """One cycle of the history."""

    cycle: int
    motion: str = ''
    law: str = ''
    bag: str = ''  # '' until it is recorded
    worst: float = nan  # [m] largest dynamic error of the worst axis
    fault: str = ''  # reason of the safe stop in this cycle
    missing: str = ''  # why it has no bag

    @property
    def outcome(self):
        """The result of the cycle in few words."""
        if self.fault:
            return 'fault'
        if self.worst == self.worst:
            return f'{1e6 * self.worst:.2f} um'
        return 'not recorded' if self.missing else 'no figures'

    @property
    def line(self):
        """The cycle as one line of a list; it begins with its number."""
        return f'{self.cycle}: {self.outcome}, {self.motion[:_NAME]}, {self.law[:_NAME]}'


class History:
    """Cycles by number, the last `MEMORY` of them."""

    def __init__(self):
        self._past = {}
        self.changes = 0  # counter, rises with every change

    def __iter__(self):
        """Iterate over the `Past` cycles, the newest first."""
        return iter(sorted(self._past.values(), key=lambda past: -past.cycle))

    def __len__(self):
        return len(self._past)

    def get(self, cycle):
        """Return the `Past` of `cycle`, None if it is unknown."""
        return self._past.get(cycle)

    def note(self, cycle, **facts):
        """Set fields of the `Past` of `cycle`."""
        past = self._past.setdefault(cycle, Past(cycle))
        for name, value in facts.items():
            setattr(past, name, value)
        if len(self._past) > MEMORY:
            del self._past[min(self._past)]
        self.changes += 1
