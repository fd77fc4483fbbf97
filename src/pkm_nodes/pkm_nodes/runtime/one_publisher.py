"""The publisher from which a node takes the messages of a topic, told from others by its GID."""

# bytes of a GID that all publishers of one participant share: with rclpy, of one process
_PARTICIPANT = 12


def participant(gid):
    """Return the part of the GID of a publisher that is the same for all publishers of its process."""
    return gid[:_PARTICIPANT]


def node_name(info):
    """Return the full name of the node of an endpoint of the graph."""
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


class OnePublisher:
    """
    The publisher that was alone on `topic` when the graph was read; it stays the one until it leaves the graph.

    Parameters
    ----------
    node : Node
        Reads the graph.
    topic : str
    besides : str, optional
        A topic: publishers of `topic` that belong to the node of its one publisher are accepted too and not counted.

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

    def __init__(self, node, topic, *, besides=None):
        self._node, self.topic = node, node.resolve_topic_name(topic)
        self._besides = None if besides is None else OnePublisher(node, besides)
        self.gid, self.nodes, self.others, self._name = b'', [], [], ''
        self._gids, self._aside = (), ()  # of all publishers at the last `look`, and of those beside the counted ones

    def look(self):
        """Read the graph; return whether the topic has at most one publisher. Takes some 40 us."""
        infos = self._node.get_publishers_info_by_topic(self.topic)
        if self._besides is not None:
            self._besides.look()
        source = '' if self._besides is None else self._besides._name
        names = {bytes(info.endpoint_gid): node_name(info) for info in infos}
        self._aside = tuple(gid for gid, name in names.items() if source and name == source)
        counted = {gid: name for gid, name in names.items() if gid not in self._aside}
        if self.gid not in counted:
            self.gid = next(iter(counted)) if len(counted) == 1 else b''
        self._gids, self._name = tuple(names), counted.get(self.gid, '')
        self.nodes = sorted(counted.values())
        self.others = sorted(name for gid, name in counted.items() if self.gid and gid != self.gid)
        return len(counted) <= 1

    def accepts(self, sender):
        """Return whether messages with this GID are taken; b'' is an unknown sender."""
        return sender in (b'', self.gid) or not self.gid or sender in self._aside

    def participants(self):
        """Return the participants of the one publisher, of all while none is known, and of those beside."""
        return {participant(gid) for gid in ((self.gid, *self._aside) if self.gid else self._gids)}

    def remark(self):
        """Return the end of a refusal of a message: its possible senders after a look at the graph, '' if one."""
        return '' if self.look() else f'; {self.describe()}; allowed: 1'

    def describe(self):
        """Return what the last `look` found, for a refusal."""
        return f'{self.topic} has {len(self.nodes)} publishers, {", ".join(self.nodes)}'
