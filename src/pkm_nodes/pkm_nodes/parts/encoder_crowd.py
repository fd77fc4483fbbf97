"""Further publishers of encoder samples, as a controller finds them."""

from time import monotonic

from pkm_core.servo.cycle_run import LEASE
from pkm_nodes.parts.intruders import SETTLE


class EncoderCrowd:
    """
    Whether every encoder that `node` subscribes to has one publisher.

    A killed machine stays in the graph, for up to 20 s if it is not of the project: a cycle waits for that time.
    """

    def __init__(self, node):
        self._node = node
        self._since = None  # [s, wall] since when there are further publishers, None if there are none
        self._clear_at = 0.0  # [s, wall] until then other nodes may still see publishers that have left

    def find(self):
        """Take samples from the publishers that are alone; return, in words, the topics that have several."""
        found = [each.publisher.describe() for each in self._node.tick_subscriptions if not each.bind()]
        now = monotonic()
        if found:
            self._clear_at = now + SETTLE
        if not found and now >= self._clear_at:
            self._since = None
            return ''
        self._since = self._since or now
        return f'{"; ".join(found) or "encoders had several publishers"}; allowed: one each. Stop the others'

    def stays(self):
        """Return whether further publishers have stayed longer than DDS keeps those of a killed node."""
        return self._since is not None and monotonic() - self._since > LEASE

    def others(self):
        """Return the nodes whose samples are dropped, in words; '' without one."""
        crowded = [each.publisher for each in self._node.tick_subscriptions if each.publisher.others]
        found = '; '.join(f'{each.topic}: {", ".join(each.others)}' for each in crowded)
        return f'samples of further publishers are dropped: {found}' if found else ''
