"""Detects that the publishers of a topic have left the graph, killed or replaced ones included."""

from pkm_nodes.runtime.one_publisher import node_name


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
        self._first = {gid: now.get(gid, name) for gid, name in self._first.items()} or now  # names may come later
        return bool(self._first) and not self._first.keys() & now.keys()

    def names(self):
        """Return the nodes of the publishers seen first, in words."""
        return ', '.join(sorted(set(self._first.values()))) or 'unknown'

    def _publishers(self):
        infos = self._node.get_publishers_info_by_topic(self._topic)
        return {bytes(info.endpoint_gid): node_name(info) for info in infos}
