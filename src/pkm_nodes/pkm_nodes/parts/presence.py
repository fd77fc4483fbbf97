"""Detects that the publishers of a topic have left the graph, killed or replaced ones included."""


class Presence:
    """
    Whether the publishers of `topic` that were seen first are still in the graph.

    They are the publishers at construction, or the first ones found later. DDS removes a killed process when its lease
    ends, 10 s after its last sign of life (fastdds.xml). Threads of DDS send these signs however long a callback takes:
    a slow process is not taken for a dead one.
    """

    def __init__(self, node, topic):
        self._node, self._topic = node, topic
        self._first = self._publishers()

    def has_ended(self):
        """Return whether none of the publishers seen first is left."""
        now = self._publishers()
        self._first = self._first or now
        return bool(self._first) and not self._first.keys() & now.keys()

    def names(self):
        """Return the nodes of the publishers seen first, in words."""
        return ', '.join(sorted(set(self._first.values()))) or 'unknown'

    def _publishers(self):
        infos = self._node.get_publishers_info_by_topic(self._topic)
        return {bytes(info.endpoint_gid): f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos}
