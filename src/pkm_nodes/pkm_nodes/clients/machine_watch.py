"""The pace of the machine in its diagnostics, for a client that waits for cycles."""

from pkm_nodes.messages.diagnostics import CYCLE, LATENESS, PACE_ASKED, PACE_REACHED, PAUSED, STATE, TICK, values_of
from pkm_nodes.parts.machine_status import subscribe_machine_status

# keys of the figures in results.json
FIGURES = ('late_mean_us', 'late_99_percent_us', 'late_largest_us', 'late_by_a_tick_percent')


class MachineWatch:
    """
    The last diagnostics of the machine of the cell of `node`.

    Attributes
    ----------
    values : dict of str to str
        By key; empty before the first message.

    """

    def __init__(self, node):
        self.values = {}
        subscribe_machine_status(node, self._on_status)

    def _on_status(self, status):
        self.values = values_of(status)

    @property
    def pause(self):
        """Where the machine is paused, in words; '' if it is not."""
        return f'paused at tick {self.values[TICK]}' if self.values.get(PAUSED) == 'true' else ''

    def has_ended(self, cycle):
        """Return whether the machine stood after `cycle` when the last message was sent."""
        return self.values.get(CYCLE) == str(cycle) and self.values[STATE] in ('standing', 'faulted')

    def figures(self):
        """
        Return the figures of the pace by name.

        Returns
        -------
        figures : dict of str to float or None
            `asked` and `reached` [simulated time per wall time], `late_mean_us`, `late_99_percent_us` and
            `late_largest_us` [us], `late_by_a_tick_percent` [%]; None without a figure.

        """
        names = {'asked': PACE_ASKED, 'reached': PACE_REACHED, **dict(zip(FIGURES, LATENESS, strict=True))}
        texts = {name: self.values.get(key, '') for name, key in names.items()}
        return {name: float(text) if text else None for name, text in texts.items()}


def sentence(figures):
    """Return `figures` of a `MachineWatch` as a sentence."""
    late = [figures[name] for name in FIGURES]
    if None in (*late, figures['reached']):
        return f'pace {figures["asked"]:g} asked; the machine has reported no figures'
    return (
        f'pace {figures["asked"]:g} asked, {figures["reached"]:.3f} reached in the last cycle; ticks began late by '
        f'{late[0]:.0f} us (mean), {late[1]:.0f} us (99 %), {late[2]:.0f} us (largest); '
        f'{late[3]:.2f} % by more than a tick'
    )
