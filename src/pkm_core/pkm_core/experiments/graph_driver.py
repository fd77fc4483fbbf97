"""How experiments find the ROS 2 graph, which the core knows nothing of: by the entry-point group `pkm.graphs`."""

from importlib.metadata import entry_points

from pkm_core.errors import PkmError


def graph_driver():
    """
    Return ``drive(runs, cycles, arrangement, folder, on_done)``, which drives runs on the graph.

    `runs` are tuples of `Condition` and seed; it returns an `Outcome` for each of `cycles` counted cycles. Bags stay in
    `folder`, if that is not None.

    Raises
    ------
    PkmError
        If no installed package has one.

    """
    found = [entry for entry in entry_points(group='pkm.graphs') if entry.name == 'drive']
    if not found:
        raise PkmError('--arrangement: no installed package drives the ROS 2 graph; without pkm_nodes give simulation')
    return found[0].load()
