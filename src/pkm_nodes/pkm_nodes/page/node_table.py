"""The table of the nodes of a cell: present, missing, or more than one of a name, with what they report."""

from pkm_nodes.page.cell import NodeLine

_TORQUE = 'computed_torque_controller'


class NodeTable:
    """
    Compares the nodes in the graph with those that a cell has.

    Parameters
    ----------
    expected : sequence of str
        Names of the nodes of the cell, in the order of the table.
    single : set of str
        Those of them that `computed_torque_controller` replaces.

    """

    def __init__(self, expected=(), single=()):
        self._expected, self._single = list(expected), set(single)

    def lines(self, present, reports, own):
        """
        Return one `NodeLine` for every node that is present or expected.

        Parameters
        ----------
        present : list of str
            Names of the nodes in the graph; a name occurs as often as it has nodes.
        reports : dict
            {name: (whether it is well, its state in words)}.
        own : str
            Name of the node of the page, which is not listed.

        """
        expected = [name for name in self._expected if not (_TORQUE in present and name in self._single)]
        others = sorted({name for name in present if not name.startswith('_')} - {*expected, own})
        return [self._line(name, present.count(name), reports.get(name)) for name in [*expected, *others]]

    def _line(self, name, count, report):
        if not count:
            return NodeLine(name, False, 'missing')
        if count > 1:
            return NodeLine(name, False, f'{count} of that name')
        return NodeLine(name, *(report or (True, 'up')))
