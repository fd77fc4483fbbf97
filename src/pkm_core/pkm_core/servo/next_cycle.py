"""The next cycle of the machine: what each joint has loaded of it."""


class NextCycle:
    """
    The LOADED events of the cycle that starts next.

    Parameters
    ----------
    joints : sequence of str
        Names; each has to load the cycle.

    Attributes
    ----------
    number : int
        The cycle that the events belong to; it stays after `clear`.

    """

    def __init__(self, joints):
        self.number = 0
        self._joints = tuple(joints)
        self._loaded = {}  # (samples, hold) by joint

    @property
    def is_empty(self):
        """Whether no joint has loaded it."""
        return not self._loaded

    @property
    def late(self):
        """The joints that have not loaded it, a list."""
        return [joint for joint in self._joints if joint not in self._loaded]

    @property
    def samples(self):
        """Length of the cycle; meaningful without `mismatch`."""
        return next(iter(self._loaded.values()))[0]

    @property
    def hold(self):
        """The sample before which all joints wait for the next piece of a jog; 0 if they do not agree."""
        holds = {hold for _, hold in self._loaded.values()}
        return holds.pop() if len(holds) == 1 else 0

    @property
    def mismatch(self):
        """Why the joints cannot start together, '' if they can."""
        lengths = {joint: self._loaded[joint][0] for joint in self._joints}
        if min(lengths.values()) == max(lengths.values()) >= 1:
            return ''
        return f'the joints loaded cycles of different lengths: {lengths}; all must be equal and at least 1'

    def loaded(self, joint, samples, hold):
        """Take a LOADED event of `joint`; its last one counts."""
        self._loaded[joint] = samples, hold

    def clear(self):
        """Forget what the joints have loaded."""
        self._loaded.clear()
