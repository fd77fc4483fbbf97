"""Messages that a subscription drops unread, in compiled code: a flood of them costs less than a microsecond each."""

from time import monotonic

import numpy as np

# place of the first field in a serialized message, after the header
KIND = 4
# most senders that are denied at the same time
_MOST = 16
# kinds from this number on are one kind
LAST_KIND = 62


class Denials:
    """
    Which messages are dropped unread, by their kind, a uint8 at the begin of the message, and their sender.

    Parameters
    ----------
    unused : collection of int
        Kinds that are dropped from every sender.

    Attributes
    ----------
    unused : ndarray of int64, shape (1,)
        Bit mask of these kinds.
    rows : ndarray of int64, shape (n, 4)
        Of each sender that is denied: its GID in two words, a bit mask of kinds, the number of dropped messages.

    """

    def __init__(self, unused=()):
        self.unused = np.array([sum(1 << kind for kind in unused)], np.int64)
        self.rows = np.zeros((_MOST, 4), np.int64)
        self._until = {}  # time [s, wall] of the end by (kind, sender)

    def deny(self, kind, sender, seconds):
        """Drop messages of `kind` from `sender`, a GID, for the next `seconds`, and until `renew` is called."""
        gid = np.frombuffer(sender, np.int64)
        rows = np.flatnonzero((self.rows[:, :2] == gid).all(axis=1))
        free = rows if len(rows) else np.flatnonzero(self.rows[:, 2] == 0)
        if not len(free):
            return
        row = self.rows[free[0]]
        if not len(rows):
            row[:] = 0
            row[:2] = gid
        row[2] |= 1 << min(kind, LAST_KIND)
        self._until[kind, sender] = monotonic() + seconds

    def denies(self, kind, sender):
        """Return whether a message of `kind` from `sender` is dropped, for executors that do not do so."""
        return self.is_unused(kind) or (kind, sender) in self._until

    def is_unused(self, kind):
        """Return whether messages of `kind` are dropped from every sender."""
        return bool(self.unused[0] >> min(kind, LAST_KIND) & 1)

    def renew(self):
        """End what is over; return the number of messages that were dropped since the last call, without `unused`."""
        dropped, now = int(self.rows[:, 3].sum()), monotonic()
        self.rows[:, 3] = 0
        for kind, sender in [key for key, until in self._until.items() if now >= until]:
            del self._until[kind, sender]
            own = (self.rows[:, :2] == np.frombuffer(sender, np.int64)).all(axis=1)
            self.rows[own, 2] &= ~(1 << min(kind, LAST_KIND))
        return dropped


NONE = Denials()
