"""The publisher from which a node takes the messages of a topic, told from others by its GID."""

# bytes of a GID that all publishers of one participant share: with rclpy, of one process
_PARTICIPANT = 12


def participant(gid):
    """Return the part of the GID of a publisher that is the same for all publishers of its process."""
    return gid[:_PARTICIPANT]


def node_names(infos):
    """Return the sorted full names of the nodes of these endpoints."""
    return sorted(f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos)


class OnePublisher:
    """
    The publisher that was alone on `topic` when the graph was read; it stays the one until it leaves the graph.

    Parameters
    ----------
    node : Node
        Reads the graph.
    topic : str

    Attributes
    ----------
    topic : str
        Resolved name.
    gid : bytes
        Of the publisher, b'' while none is known: before the first `look`, or when that found several.
    nodes : list of str
        Nodes of all publishers at the last `look`, one entry per publisher.
    others : list of str
        Nodes of the publishers at the last `look` other than the one; empty while none is known.

    """

    def __init__(self, node, topic):
        self._node, self.topic = node, node.resolve_topic_name(topic)
        self.gid, self.nodes, self.others = b'', [], []
        self._gids = ()  # of all publishers at the last `look`

    def look(self):
        """Read the graph; return whether the topic has at most one publisher. Takes some 40 us."""
        infos = self._node.get_publishers_info_by_topic(self.topic)
        by_gid = {bytes(info.endpoint_gid): info for info in infos}
        if self.gid not in by_gid:
            self.gid = next(iter(by_gid)) if len(by_gid) == 1 else b''
        self._gids, self.nodes = tuple(by_gid), node_names(infos)
        self.others = node_names(info for gid, info in by_gid.items() if self.gid and gid != self.gid)
        return len(by_gid) <= 1

    def participants(self, strict):
        """Return the participants of all publishers at the last `look`, or with `strict` of the one if it is known."""
        return {participant(gid) for gid in ([self.gid] if strict and self.gid else self._gids)}

    def describe(self):
        """Return what the last `look` found, for a refusal."""
        return f'{self.topic} has {len(self.nodes)} publishers, {", ".join(self.nodes)}'
