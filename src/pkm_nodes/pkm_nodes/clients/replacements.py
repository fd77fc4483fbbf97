"""Who takes the place of the nodes that a cell leaves out, and who is still missing."""

import shlex

from pkm_core.errors import PkmError


class Substitutes:
    """
    What `node` sees in the graph of the nodes that `cell`, a `CellProcesses`, leaves out.

    Others take their place as soon as they offer the topics and services without which no motion runs.
    """

    def __init__(self, node, cell):
        self._node, self._cell = node, cell
        self._ours = [spec.name for spec in cell.nodes]

    def missing(self):
        """Return [(NodeSpec, the names nobody else offers)] of the nodes in whose place there is nobody."""
        names = [(spec, [n for n in spec.offers if not self._is_offered(n)]) for spec in self._cell.left_out]
        return [(spec, missing) for spec, missing in names if missing]

    def check(self):
        """Raise `PkmError` if a process of the cell has ended, or whoever took a place has gone."""
        self._cell.check()
        if gone := self.describe_missing():
            raise PkmError(f'somebody has gone: {gone}')

    def _is_offered(self, name):
        """Tell whether a node that is none of ours publishes the topic `name`, or whether there is such a service."""
        publishers = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(name))
        return any(each.node_name not in self._ours for each in publishers) or self._node.count_services(name) > 0

    def describe_missing(self):
        """Return one line for each node in whose place there is nobody: what it would offer, and how to start ours."""
        lines = []
        for spec, names in self.missing():
            topics = ', '.join(map(self._node.resolve_topic_name, names))
            ours = shlex.join(['ros2', 'run', 'pkm_nodes', spec.executable, *self._cell.arguments(spec)])
            lines.append(f'nobody offers {topics} in the place of {spec.name}; start yours, or ours: {ours}')
        return '\n'.join(lines)
