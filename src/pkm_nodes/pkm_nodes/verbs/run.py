"""
`pkm run`: start a cell, run a motion for a number of learning cycles, and print its figures.

Libraries are imported where they are used: a refused option or motion does not wait for compilers and figures.
"""

from dataclasses import dataclass
from math import isnan, nan
from pathlib import Path
from typing import Annotated, Any

import typer

from pkm_core.arrangement import Arrangement
from pkm_core.config import find_config
from pkm_core.errors import PkmError
from pkm_core.files import do_all, refused_if_unwritable, write_json
from pkm_core.interrupts import Interrupted
from pkm_core.servo.pace import checked_pace
from pkm_core.verbs.completion import names_of
from pkm_core.verbs.console import Output, progress_bar
from pkm_core.verbs.options import (
    LAWS,
    CellArrangementOption,
    ControllerOption,
    CyclesOption,
    EnvironmentOption,
    JsonOption,
    LearningTargetOption,
    MachineOption,
    MotionOption,
    NamespaceOption,
    OverwriteOption,
    PaceOption,
    RunFolderOption,
    SeedOption,
    file_option,
    run_folder,
    write_figures,
)
from pkm_nodes.graph import NAMESPACE, cell_nodes, namespace_of
from pkm_nodes.runtime.discovery import discover_on_this_computer

_LAWS = {'robust': 'fourier_pid', 'observer': 'inverse'}  # default by kind of control; none for others


def _nodes(ctx: typer.Context, incomplete: str):
    """Return the names of the nodes of the machine chosen so far, for completion."""
    try:
        nodes = cell_nodes(
            ctx.params.get('machine_name') or 'four_dof', control=ctx.params.get('controller') or 'robust'
        )
    except PkmError:
        return []
    return [spec.name for spec in nodes if spec.name.startswith(incomplete)]


def run(
    machine_name: MachineOption = 'four_dof',
    motion: MotionOption = '',
    cycles: CyclesOption = 12,
    law: Annotated[
        str,
        typer.Option(
            autocompletion=names_of('learning', more=('none',)),
            help=f'{LAWS}, none; or a YAML file. Default: {_LAWS["robust"]} with robust controllers, '
            f'{_LAWS["observer"]} with observers, none with computed torque.',
        ),
    ] = '',
    controller: ControllerOption = 'robust',
    learned: Annotated[Path | None, typer.Option(help='Initial feedforward: a file written by --save-learned.')] = None,
    save_learned: Annotated[
        Path | None, typer.Option(callback=file_option, help='Save the best learned feedforward to this file.')
    ] = None,
    seed: SeedOption = 1,
    environment: EnvironmentOption = 'nominal',
    namespace: NamespaceOption = NAMESPACE,
    arrangement: CellArrangementOption = Arrangement.composed,
    learning_target: LearningTargetOption = 'joints',
    pace: PaceOption = 0.0,
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar='NODE',
            autocompletion=_nodes,
            help='Do not start this node, because another node replaces it; repeatable.',
        ),
    ] = None,
    out: RunFolderOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Run a motion for a number of learning cycles in the ROS 2 graph.

    Writes one MCAP bag per cycle, results.json and learning.png into --out, and prints the first beside the last cycle.
    Ctrl-C ends the run and keeps all whole cycles, with results.json.

    Example: `pkm run --cycles 12 --law fourier_pid --arrangement processes`

    Example: `pkm run --machine planar --cycles 20 --learning-target tool`

    Example: `pkm run --cycles 3 --pace 1`

    Example: `pkm run --without joint_controller_d3`
    """
    discover_on_this_computer()
    console = Output()
    namespace = namespace_of(namespace)
    goal = _Goal.checked(machine_name, motion, cycles, law, controller, learned, save_learned, learning_target)
    cell = {'control': controller, 'seed': seed, 'environment': environment, 'without': without or []}
    cell |= {'learning_target': learning_target, 'pace': checked_pace(pace, '--pace')}
    if pace and 'machine' in cell['without']:
        raise PkmError(f'--pace: {pace} given with --without machine; the machine of this cell has the pace')
    # refuses unknown names before a process starts
    options = {'seed': seed, 'environment': environment, 'without': cell['without']}
    cell_nodes(machine_name, control=controller, learning_target=learning_target, **options)
    out = run_folder(out, goal.machine.name)
    try:
        driven = _drive(console, machine_name, arrangement, namespace, cell, goal, out)
        log, records, session, not_saved, figures_of_pace, interrupted = driven
    except PkmError as error:
        raise PkmError(f'{error}\nlogs and bags of the cell are in {out}') from None
    from pkm_core.recording.provenance import config_hash, loop_hash, machine_hash

    hashes = {record.facts.get('config_hash', '') for record in records}
    loop = loop_hash(goal.machine, controller, machine_hash(machine_name))
    expected = config_hash([loop], Path(goal.motion).stem, goal.law)
    if hashes != {expected}:
        raise PkmError(
            f'{out}: the bags have the configuration {sorted(hashes)}, the files now {expected}; '
            'expected files that do not change during a run'
        )
    cell['session'] = session
    log.notices.extend(filter(None, [goal.still]))
    results = _results(goal, cell, arrangement, expected, log, records) | {'pace': figures_of_pace}
    do_all(  # a full disk loses one of these, not all
        lambda: _print_tables(console, goal.machine.name, records),
        lambda: write_json(out / 'results.json', results),
        lambda: write_figures(json_file, results),
        lambda: _plot(records, out / 'learning.png'),
        lambda: _print_account(console, results, out),
        lambda: _refuse(not_saved),
    )
    if interrupted:
        console.plain(f'interrupted after {len(records)} of {goal.cycles} cycles; these are kept')
        raise interrupted


def _print_tables(console, machine, records):
    from pkm_core.reporting.summary import cycles_table
    from pkm_core.reporting.tool import tool_table

    console.print(cycles_table(machine, records))
    if at_tool := tool_table(records):
        console.print(at_tool)


def _plot(records, path):
    from pkm_core.reporting.figures import plot_cycles

    with refused_if_unwritable(path):
        plot_cycles(records, path)


def _refuse(reason):
    if reason:
        raise PkmError(reason)


@dataclass(frozen=True)
class _Goal:
    """What the cell is to do, checked before any process starts."""

    machine: Any  # a `Machine`
    motion: str
    cycles: int
    law: str
    learned: Path | None
    save_learned: Path | None
    still: str  # moves in which nothing moves

    @property
    def files(self):
        """Folders that the cell may use because the user named files in them, as keywords of `CellProcesses`."""
        from pkm_core.learning import law_file

        law = '' if self.law == 'none' else str(law_file(self.law).resolve().parent)
        return {'plugins': law, 'learned': self.save_learned.resolve().parent if self.save_learned else ''}

    @classmethod
    def checked(cls, machine_name, motion, cycles, law, controller, learned, save_learned, learning_target):
        """Return the goal of these options of the verb; `PkmError` if the cell would refuse it."""
        from pkm_core.machines import load_machine
        from pkm_core.motion.planning import default_motion, load_motion, plan, still_moves
        from pkm_core.motion.trajectory import to_joints

        for kind, name in (('machines', machine_name), ('motions', motion)):
            if name:
                find_config(kind, name)  # an unknown name is refused before units and models are loaded
        machine = load_machine(machine_name)
        motion = motion or default_motion(machine)
        poses = plan(machine, load_motion(motion))
        joints = to_joints(machine, poses)
        from pkm_core.control.controllers import SINGLE_AXIS, choose_control, kind_of
        from pkm_core.learning import law_file, make_law

        gains = choose_control(machine, controller)
        kind = kind_of(gains)
        law = law or _LAWS.get(kind, 'none')
        if law != 'none':
            law_file(law)
            if kind not in SINGLE_AXIS:
                raise PkmError(f'--law: {law!r} given; --controller {controller} does not learn, expected none')
        elif save_learned:
            raise PkmError('--save-learned: given with --law none, which learns nothing; expected a learning law')
        if save_learned:
            from pkm_core.learning.store import check_replaceable

            check_replaceable(save_learned)
        if learning_target == 'tool':
            if law == 'none':
                raise PkmError('--learning-target: tool given with --law none, which learns nothing; expected a law')
            from pkm_core.learning.tool import make_tool_law

            make_tool_law(machine, gains, make_law(law, machine, gains), poses, joints)
        if learned:
            from pkm_core.learning.initial import first_feedforward

            first_feedforward(learned, machine, Path(motion).stem, law, gains, joints)
        return cls(machine, motion, cycles, law, learned, save_learned, still_moves(machine, joints))


def _drive(console, machine_name, arrangement, namespace, cell_options, goal, out):
    """
    Run the goal.

    Returns
    -------
    log, records : CycleLog, list of CycleRecord
        Of the cycles and their bags.
    session : str
        Of the cell.
    not_saved : str
        Why the learned feedforward was not saved, '' if it was or need not be.
    pace : dict
        Figures of a `MachineWatch`.
    interrupted : Interrupted or None
        The signal that ended the motion after at least one whole cycle.

    """
    from pkm_nodes.clients.cell_client import CellClient
    from pkm_nodes.clients.cell_processes import CellProcesses
    from pkm_nodes.clients.own_bags import read_own

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
        what = f'{Path(goal.motion).stem}, law {goal.law}'
        bar.show(name=what)

        def on_feedback(feedback):
            worst = max((e for e in feedback.max_dynamic_error if not isnan(e)), default=nan) * 1e6
            bar.show(feedback.cycle, f'{what}: worst axis {worst:5.1f} um')

        learned = goal.learned.resolve() if goal.learned else ''

        shown = ''  # pause of the machine

        def check_and_tell():
            nonlocal shown
            check()
            if client.machine.pause != shown:
                shown = client.machine.pause
                bar.show(name=f'{what}: {shown}' if shown else what)

        not_saved, interrupted = '', None
        try:
            log = client.execute(goal.motion, goal.cycles, goal.law, check_and_tell, on_feedback, learned=learned)
        except Interrupted as signal:
            log, interrupted = client.log_so_far(), signal
            if not log.bags:
                console.plain(f'interrupted within the first cycle; its bag is in {cell.bags}')
                raise
        known = interrupted or not cell_options['pace']
        pace = client.machine.figures() if known else client.pace_figures(check)
        if goal.save_learned and not interrupted:
            try:
                client.save_learned(goal.save_learned.resolve(), check)
            except PkmError as error:  # the cycles have run: their results are kept
                not_saved = str(error)
        return log, read_own(log.bags, cell), cell.session, not_saved, pace, interrupted


def _results(goal, cell, arrangement, hash_of_config, log, records):
    """Return the content of results.json."""
    from pkm_core.reporting.summary import cycle_figures, messages
    from pkm_core.reporting.tool import tool_figures

    return {
        'machine': goal.machine.name,
        'motion': Path(goal.motion).stem,
        'law': goal.law,
        'learned': str(goal.learned) if goal.learned else None,
        **cell,
        'without': ', '.join(cell['without']),  # reports show it as text
        'arrangement': arrangement,
        'config_hash': hash_of_config,
        'sample_time_s': goal.machine.sample_time,
        'ticks': log.ticks,
        'ticks_per_second': log.ticks / log.seconds,
        'ticks_per_second_in_cycles': log.ticks / log.seconds_in_cycles,
        'messages': messages(records),
        'notices': log.notices,
        'cycles': [
            {'cycle': r.cycle, 'bag': r.path.name, 'axes': cycle_figures(r), 'tool': tool_figures(r)} for r in records
        ],
    }


def _print_account(console, results, out):
    """Print speed, notices, recorded and expected messages."""
    from pkm_nodes.clients.machine_watch import sentence

    counted = [entry for entry in results['messages'].values() if entry['expected'] is not None]
    recorded, expected = (sum(entry[key] for entry in counted) for key in ('recorded', 'expected'))
    lost = sum(max(0, entry['expected'] - entry['recorded']) for entry in counted)
    surplus = recorded - expected + lost
    console.print(
        f'{results["ticks"]} ticks in {len(results["cycles"])} cycles: '
        f'{results["ticks_per_second_in_cycles"]:.0f} ticks/s while moving, '
        f'{results["ticks_per_second"]:.0f} ticks/s with the pauses for learning ({results["arrangement"]})'
    )
    if results['pace']['asked']:
        console.plain(sentence(results['pace']))
    for notice in results['notices']:
        console.plain(notice)
    console.print(f'{recorded} messages recorded of {expected} expected: {lost} lost')
    if surplus:
        console.print(f'{surplus} messages more than expected: topics of the cell have further publishers')
    console.plain(f'bags, results.json and learning.png are in {out}')
