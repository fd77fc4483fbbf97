"""The stream of commanded velocities of a jog: one commander, and a stop when it is silent."""

from enum import Enum
from math import inf

import numpy as np

from pkm_core.errors import TrajectoryError

# [s, wall] chosen: a stop is complete within 94 ms: 40 ms of silence, the piece in use and the next one of 15 ms each,
# which may have been sent before, and a stop of 24 ms
SILENCE = 0.04
# [s, wall] chosen: after this silence the jog ends; until then the same cycle follows the next message
END_AFTER = 0.3


class JogState(Enum):
    """State of the stream."""

    IDLE = 'idle'
    STARTING = 'starting'  # the first piece, which rests, is sent
    JOGGING = 'jogging'  # the machine runs the cycle
    ENDING = 'ending'  # no further piece is sent; the machine stops by itself
    BLOCKED = 'blocked'  # after a refusal or an end, until every commander has been silent


class JogStream:
    """
    State machine of the stream. Times are [s, monotonic].

    Every message of a commander is passed to `commanded`. `due` is called regularly and returns the velocity of the
    next piece; without a call the machine stops by itself.

    Parameters
    ----------
    period : float
        [s, wall] between two pieces: the simulated time of a piece.

    Attributes
    ----------
    state : JogState
    commander : str
        Who commands the jog, '' without one.

    """

    def __init__(self, period):
        self._period = period
        self.state, self.commander, self._sender = JogState.IDLE, '', b''
        self._twist = np.zeros(0)
        self._heard = self._any = -inf  # time of the last message of the commander, of all
        self._sent = -inf  # time of the last piece
        self._is_free = False  # the machine uses the last piece
        self._is_refused = False  # the jog ends for another reason than silence

    @property
    def runs(self):
        """Whether a jog has begun and not ended."""
        return self.state in (JogState.STARTING, JogState.JOGGING, JogState.ENDING)

    def commanded(self, now, commander, twist, sender=b''):
        """
        Take a message: `twist` (m,) [m/s, rad/s]. Return whether a jog begins: call `begun` or `block` then.

        `commander` is a name, `sender` the GID of the publisher or empty: the name of a new node may be unknown at
        first. A stream of zeros begins nothing. Neither does one that continues after a refusal or an end: it has to be
        silent for `END_AFTER` first.

        Raises
        ------
        TrajectoryError
            If another commander runs the jog.

        """
        own = sender == self._sender if sender else commander == self.commander
        if self.runs and own:
            self.commander = commander
        elif self.runs:
            raise TrajectoryError(
                f'jog of {commander}: the jog of {self.commander} is running; wait until it has been silent for '
                f'{END_AFTER:g} s'
            )
        silent, self._any = now - self._any, now
        if self.state is JogState.BLOCKED and silent >= END_AFTER:
            self.state = JogState.IDLE
        if self.runs:
            self._heard, self._twist = now, np.asarray(twist, dtype=float)
            return False
        return self.state is JogState.IDLE and bool(np.any(twist))

    def begun(self, now, commander, twist, sender=b''):
        """Begin a jog: its first piece, which rests, is sent."""
        self.state, self.commander, self._sender = JogState.STARTING, commander, sender
        self._heard, self._twist = now, np.asarray(twist, dtype=float)
        self._sent, self._is_free, self._is_refused = now, False, False

    def block(self, now):
        """Take no message until every commander has been silent: of a stream that was refused."""
        self.state, self.commander, self._any = JogState.BLOCKED, '', now

    def accepted(self):
        """Note that the machine has started the cycle, or uses the last piece."""
        if self.state in (JogState.STARTING, JogState.JOGGING):
            self.state, self._is_free = JogState.JOGGING, True

    def due(self, now):
        """
        Return the velocity (m,) of the next piece, or None if none is due.

        It is zero while the commander is silent for more than `SILENCE`. After `END_AFTER` the jog ends.
        """
        if self.state is not JogState.JOGGING or not self._is_free or now - self._sent < self._period:
            return None
        silent = now - self._heard
        if silent > END_AFTER:
            self.state = JogState.ENDING
            return None
        self._is_free = False
        # a piece that is late by less than a period does not delay the following ones
        self._sent = max(self._sent + self._period, now - self._period)
        return self._twist if silent <= SILENCE else np.zeros_like(self._twist)

    def stop(self):
        """Send no further piece: the machine stops by itself, and a stream that continues begins no further jog."""
        if self.runs:
            self.state, self._is_refused = JogState.ENDING, True

    def ended(self):
        """Note that the cycle has ended."""
        self.state, self.commander = JogState.BLOCKED if self._is_refused else JogState.IDLE, ''
