"""Runs of `pkm experiment` in the ROS graph: one cell per run, from power-up to its bags."""

from pathlib import Path
from tempfile import TemporaryDirectory

from pkm_core.experiments.condition import prepared
from pkm_core.experiments.outcome import outcome
from pkm_core.files import writable_folder
from pkm_core.learning.store import Learned, origin_of, save
from pkm_nodes.runtime.discovery import discover_on_this_computer


def drive(runs, cycles, arrangement, folder, on_done):
    """Return the `Outcome`s of `runs`, see `pkm_core.experiments.graph_driver.graph_driver`."""
    discover_on_this_computer()
    outcomes = []
    with TemporaryDirectory(prefix='pkm_experiment_') as scratch:
        for condition, seed in runs:
            name = '_'.join((condition.name.replace(' ', '_'), condition.environment, str(seed)))
            place = writable_folder((Path(scratch) if folder is None else folder / 'runs') / name)
            records, notices = _run(condition, seed, condition.settled + cycles, arrangement, place)
            outcomes.append(outcome(condition, seed, records, notices, prepared(condition).machine))
            on_done(len(outcomes), name)
    return outcomes


def _run(condition, seed, cycles, arrangement, folder):
    """Return the `CycleRecord`s of a run and the notices of the cell."""
    from pkm_nodes.clients.cell_client import CellClient
    from pkm_nodes.clients.cell_processes import CellProcesses
    from pkm_nodes.clients.own_bags import read_own

    machine, motion, _, joints, gains, _, start = prepared(condition)
    learned = ''
    if start is not None:
        learned = folder.resolve() / 'design.npz'
        save(learned, Learned(origin_of(machine, motion, 'design', gains, joints), start, {}))
    cell_options = {'control': condition.control, 'seed': seed, 'environment': condition.environment}
    with (
        CellProcesses(condition.machine, arrangement, **cell_options, folder=folder) as cell,
        CellClient(session=cell.session) as client,
    ):
        client.wait_until_up(cell.check)
        log = client.execute(motion, cycles, condition.law, cell.check, lambda feedback: None, learned=learned)
        records = list(read_own(log.bags, cell))
    return records, log.notices
