"""Access of experiments to the ROS 2 graph by the entry-point group `pkm.graphs`; the core does not import ROS."""

from importlib.metadata import entry_points

from pkm_core.errors import PkmError


def graph_driver():
    """
    Return ``drive(runs, cycles, arrangement, folder, on_done)``, which executes runs on the graph.

    `runs` are tuples of `Condition` and seed; the result is one `Outcome` of `cycles` counted cycles per run. Bags are
    kept in `folder`, if it is not None.

    Raises
    ------
    PkmError
        If no installed package has such an entry point.

    """
    found = [entry for entry in entry_points(group='pkm.graphs') if entry.name == 'drive']
    if not found:
        raise PkmError('--arrangement: no installed package drives the ROS 2 graph; allowed: simulation')
    return found[0].load()
