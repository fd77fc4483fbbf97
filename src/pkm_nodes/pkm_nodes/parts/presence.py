"""Notices that a process one waits for is gone: also one that was killed, and that another has come in its place."""


class Presence:
    """
    Whether whoever publishes `topic` when this is made, or is found first, still does.

    DDS takes a process that was killed out of the graph when its lease ends, 20 s after its last sign of life. The
    threads of DDS give those signs, however long a tick or a callback may take: who is slow is not taken for gone.
    """

    def __init__(self, node, topic):
        self._node, self._topic = node, topic
        self._first = self._publishers()

    def has_ended(self):
        """Tell whether none of those publishers is there any more."""
        now = self._publishers()
        self._first = self._first or now
        return bool(self._first) and not self._first & now

    def _publishers(self):
        return {bytes(info.endpoint_gid) for info in self._node.get_publishers_info_by_topic(self._topic)}
