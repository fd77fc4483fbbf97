"""Replacements of the nodes that a cell leaves out, as seen in the graph."""

import shlex

from pkm_core.errors import PkmError


class Substitutes:
    """
    The replacements of the nodes that `cell`, a `CellProcesses`, leaves out, as `node` sees them in the graph.

    A node is replaced when other nodes offer all its topics and services that a motion needs.
    """

    def __init__(self, node, cell):
        self._node, self._cell = node, cell
        self._ours = [spec.name for spec in cell.nodes]

    def missing(self):
        """Return [(NodeSpec, missing topics and services)] of the nodes without replacement."""
        names = [(spec, [n for n in spec.offers if not self._is_offered(n)]) for spec in self._cell.left_out]
        return [(spec, missing) for spec, missing in names if missing]

    def check(self):
        """Raise `PkmError` if a process of the cell has ended or a replacement has left the graph."""
        self._cell.check()
        if gone := self.describe_missing():
            raise PkmError(f'a replacement has left: {gone}')

    def _is_offered(self, name):
        """Return whether a foreign node publishes the topic `name`, or a service of this name exists."""
        publishers = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(name))
        return any(each.node_name not in self._ours for each in publishers) or self._node.count_services(name) > 0

    def describe_missing(self):
        """Return one line per node without replacement: missing topics and services, and how to start the original."""
        lines = []
        for spec, names in self.missing():
            topics = ', '.join(map(self._node.resolve_topic_name, names))
            ours = shlex.join(['ros2', 'run', 'pkm_nodes', spec.executable, *self._cell.arguments(spec)])
            lines.append(f'{spec.name}: no replacement offers {topics}; start one, or the original: {ours}')
        return '\n'.join(lines)
