"""A `RunGoal` in a cell of its own: start the cell, run the motion, read the bags."""

from math import isnan, nan
from pathlib import Path
from typing import Any, NamedTuple

from pkm_core.errors import PkmError
from pkm_core.interrupts import Interrupted
from pkm_core.verbs.console import progress_bar


class Driven(NamedTuple):
    """What has become of a goal."""

    log: Any  # `CycleLog`
    records: Any  # `RunRecords` of the bags
    session: str  # of the cell
    not_saved: str  # why the learned feedforward was not saved, '' if it was or need not be
    pace: dict  # figures of a `MachineWatch`
    interrupted: Interrupted | None  # the signal that ended the motion after at least one whole cycle


class EndedEarlyError(PkmError):
    """A goal ended before its last cycle; with the records of the whole cycles, and a line per bag with losses."""

    def __init__(self, reason, records, losses):
        super().__init__(reason)
        self.records, self.losses = records, losses


def drive(console, machine_name, arrangement, namespace, cell_options, goal, out):
    """
    Run the `RunGoal` and return `Driven`.

    Parameters
    ----------
    console : Output
        For progress and hints.
    machine_name, arrangement, namespace, cell_options
        As for `CellProcesses`.
    goal : RunGoal
        What the cell does.
    out : Path
        Folder of the cell.

    Raises
    ------
    EndedEarlyError
        If the motion ends before its last cycle.
    PkmError
        If the cell does not start, or a bag is not its own.

    """
    from pkm_core.reporting.run_records import RunRecords
    from pkm_nodes.clients.cell_client import CellClient
    from pkm_nodes.clients.cell_processes import CellProcesses
    from pkm_nodes.clients.own_bags import complete_of, losses_in, read_own

    failure = not_saved = ''
    interrupted, pace = None, {}
    with (
        progress_bar(console, goal.cycles, name='starting the cell', keep=True) as bar,
        CellProcesses(machine_name, arrangement, namespace=namespace, **cell_options, **goal.files, folder=out) as cell,
        CellClient(namespace, cell.session) as client,
    ):
        check = cell.check
        if cell.left_out:
            bar.show(name='waiting for the replacements of nodes left out')
            check = client.wait_for_others(cell, console.plain)
        client.wait_until_up(check)
        try:
            _execute(client, goal, check, bar)
            pace = client.pace_figures(check) if cell_options['pace'] else client.machine.figures()
            not_saved = _save(client, goal, check)
        except Interrupted as signal:
            interrupted, pace = signal, client.machine.figures()
            if not client.log.bags:
                console.plain(f'interrupted within the first cycle; its bag is in {cell.bags}')
                raise
        except PkmError as error:  # the recorder closes the last bag at the end of the cell
            failure = str(error)
    if failure:
        raise EndedEarlyError(failure, RunRecords(complete_of(client.log.bags, cell)), losses_in(cell.bags))
    return Driven(client.log, RunRecords(read_own(client.log.bags, cell)), cell.session, not_saved, pace, interrupted)


def _execute(client, goal, check, bar):
    """Run the motion and show its progress."""
    what, shown = f'{Path(goal.motion).stem}, law {goal.law}', ''  # `shown`: pause of the machine
    bar.show(name=what)

    def on_feedback(feedback):
        worst = max((e for e in feedback.max_dynamic_error if not isnan(e)), default=nan) * 1e6
        bar.show(feedback.cycle, f'{what}: worst axis {worst:5.1f} um')

    def check_and_tell():
        nonlocal shown
        check()
        if client.machine.pause != shown:
            shown = client.machine.pause
            bar.show(name=f'{what}: {shown}' if shown else what)

    learned = goal.learned.resolve() if goal.learned else ''
    client.execute(goal.motion, goal.cycles, goal.law, check_and_tell, on_feedback, learned=learned)


def _save(client, goal, check):
    """Save the learned feedforward; return why that failed, '' if it has not: the cycles have run and are kept."""
    if not goal.save_learned:
        return ''
    try:
        client.save_learned(goal.save_learned.resolve(), check)
    except PkmError as error:
        return str(error)
    return ''
