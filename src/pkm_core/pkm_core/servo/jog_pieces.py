"""The pieces of a jog on the machine: a cycle that is extended while it runs."""


class JogPieces:
    """
    Which part of the running cycle is loaded, and whether all joints have loaded the next piece.

    Every piece ends at rest. The machine waits at `hold` for the next one, and without it drives the rest of this one.

    Parameters
    ----------
    joints : sequence of str
        Names; the cycle is extended when each has loaded the same piece.

    Attributes
    ----------
    samples : int
        Length of the cycle with the pieces in use.
    hold : int
        Sample before which the machine waits for the next piece; 0 if none is accepted.

    """

    def __init__(self, joints):
        self._joints = frozenset(joints)
        self._next = {}  # (samples, hold) of the next piece by joint
        self.samples = self.hold = 0

    @property
    def stop(self):
        """The sample before which `advanced` does more than send samples."""
        return self.hold or self.samples

    def begin(self, samples, hold):
        """Begin a cycle; a `hold` that is not within it is none."""
        self._next.clear()
        self.samples, self.hold = samples, hold if 0 < hold < samples else 0

    def loaded(self, joint, samples, hold):
        """Take a LOADED event of the running cycle; one that extends nothing is ignored."""
        if self.hold and samples > self.samples and (hold == 0 or self.hold < hold < samples):
            self._next[joint] = samples, hold

    def extend(self):
        """Use the next piece if all joints have loaded the same one; return whether it is in use."""
        if not self.hold or self._next.keys() != self._joints or len(set(self._next.values())) > 1:
            return False
        self.samples, self.hold = next(iter(self._next.values()))
        self._next.clear()
        return True

    def close(self):
        """Accept no further piece: the cycle ends as it is loaded."""
        self._next.clear()
        self.hold = 0
