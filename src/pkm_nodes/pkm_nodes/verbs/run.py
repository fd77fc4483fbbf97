"""`pkm run`: start a cell, run a motion for a number of learning cycles, and print its figures."""

from dataclasses import dataclass
from math import isnan, nan
from pathlib import Path
from typing import Annotated, Any

import typer

from pkm_core.arrangement import Arrangement
from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.errors import PkmError
from pkm_core.files import do_all, refused_if_unwritable, write_json
from pkm_core.learning import law_file, make_law
from pkm_core.learning.initial import first_feedforward
from pkm_core.learning.store import check_replaceable
from pkm_core.learning.tool import make_tool_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan, still_moves
from pkm_core.motion.trajectory import to_joints
from pkm_core.recording.provenance import config_hash, loop_hash, machine_hash, truth_hash
from pkm_core.reporting.figures import plot_cycles
from pkm_core.reporting.summary import cycle_figures, cycles_table, messages
from pkm_core.reporting.tool import tool_figures, tool_table
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
    RunFolderOption,
    SeedOption,
    file_option,
    run_folder,
    write_figures,
)
from pkm_nodes.clients.own_bags import EndedEarlyError, complete_of, losses_in, read_own
from pkm_nodes.graph import NAMESPACE, cell_nodes, namespace_of
from pkm_nodes.runtime.discovery import discover_on_this_computer

_LAW = 'fourier_pid'


def run(
    machine_name: MachineOption = 'four_dof',
    motion: MotionOption = '',
    cycles: CyclesOption = 12,
    law: Annotated[
        str,
        typer.Option(
            help=f'{LAWS}, none; or a YAML file. Default: {_LAW} with robust controllers, none with computed torque.'
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
    without: Annotated[
        list[str] | None,
        typer.Option(metavar='NODE', help='Do not start this node, because another node replaces it; repeatable.'),
    ] = None,
    out: RunFolderOption = None,
    json_file: JsonOption = None,
):
    """
    Run a motion for a number of learning cycles in the ROS 2 graph.

    Writes one MCAP bag per cycle, results.json and learning.png into --out, and prints the first beside the last cycle.

    Example: `pkm run --cycles 12 --law fourier_pid --arrangement processes`

    Example: `pkm run --machine planar --cycles 20 --learning-target tool`

    Example: `pkm run --without joint_controller_d3`
    """
    discover_on_this_computer()
    console = Output()
    namespace = namespace_of(namespace)
    goal = _Goal.checked(machine_name, motion, cycles, law, controller, learned, save_learned, learning_target)
    cell = {'control': controller, 'seed': seed, 'environment': environment, 'without': without or []}
    cell |= {'learning_target': learning_target}
    # refuses unknown names before a process starts
    options = {'seed': seed, 'environment': environment, 'without': cell['without']}
    cell_nodes(machine_name, control=controller, learning_target=learning_target, **options)
    out = run_folder(out, goal.machine.name)
    if (out / 'results.json').exists():
        raise PkmError(f'--out: {out} has the results of another run; expected a folder without results.json')
    try:
        log, records, session, not_saved = _drive(console, machine_name, arrangement, namespace, cell, goal, out)
    except EndedEarlyError as end:
        if end.records:
            _print_tables(console, goal.machine.name, end.records)
        for line in end.losses:
            console.plain(line)
        raise PkmError(f'{end}\nlogs and bags of the cell are in {out}') from None
    except PkmError as error:
        raise PkmError(f'{error}\nlogs and bags of the cell are in {out}') from None
    hashes = {record.facts.get('config_hash', '') for record in records}
    expected = _hash_of_files(goal, machine_name, cell)
    if hashes != {expected}:
        raise PkmError(
            f'{out}: the bags have the configuration {sorted(hashes)}, the files now {expected}; '
            'expected files that do not change during a run'
        )
    cell['session'] = session
    log.notices.extend(filter(None, [goal.still]))
    results = _results(goal, cell, arrangement, expected, log, records)
    do_all(  # a full disk loses one of these, not all
        lambda: _print_tables(console, goal.machine.name, records),
        lambda: write_json(out / 'results.json', results),
        lambda: write_figures(json_file, results),
        lambda: _plot(records, out / 'learning.png'),
        lambda: _print_account(console, results, out),
        lambda: _refuse(not_saved),
    )


def _hash_of_files(goal, machine_name, cell):
    """Return the hash of the files of a run as they are now; `cell` is the options of its cell."""
    loops = [loop_hash(goal.machine, cell['control'], machine_hash(machine_name))]
    if 'machine' not in cell['without']:
        loops.append(truth_hash(goal.machine))
    learns_at_tool = cell['learning_target'] == 'tool' and 'tool_learning' not in cell['without']
    tool_law = {'tool_law': 'laser'} if learns_at_tool else {}
    return config_hash(loops, Path(goal.motion).stem, goal.law, **tool_law)


def _print_tables(console, machine, records):
    console.print(cycles_table(machine, records))
    if at_tool := tool_table(records):
        console.print(at_tool)


def _plot(records, path):
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
        law = '' if self.law == 'none' else str(law_file(self.law).resolve().parent)
        return {'plugins': law, 'learned': self.save_learned.resolve().parent if self.save_learned else ''}

    @classmethod
    def checked(cls, machine_name, motion, cycles, law, controller, learned, save_learned, learning_target):
        """Return the goal of these options of the verb; `PkmError` if the cell would refuse it."""
        machine = load_machine(machine_name)
        motion = motion or default_motion(machine)
        poses = plan(machine, load_motion(motion))
        joints = to_joints(machine, poses)
        gains = choose_control(machine, controller)
        kind = kind_of(gains)
        law = law or (_LAW if kind == 'robust' else 'none')
        if law != 'none':
            law_file(law)
            if kind != 'robust':
                raise PkmError(f'--law: {law!r} given; --controller {controller} does not learn, expected none')
        elif save_learned:
            raise PkmError('--save-learned: given with --law none, which learns nothing; expected a learning law')
        if save_learned:
            check_replaceable(save_learned)
        if learning_target == 'tool':
            if law == 'none':
                raise PkmError('--learning-target: tool given with --law none, which learns nothing; expected a law')
            make_tool_law(machine, gains, make_law(law, machine, gains), poses, joints)
        if learned:
            first_feedforward(learned, machine, Path(motion).stem, law, gains, joints)
        return cls(machine, motion, cycles, law, learned, save_learned, still_moves(machine, joints))


def _drive(console, machine_name, arrangement, namespace, cell_options, goal, out):
    """Return the `CycleLog` of the cell, the `CycleRecord`s of its bags, its session, and why nothing was saved."""
    from pkm_nodes.clients.cell_client import CellClient
    from pkm_nodes.clients.cell_processes import CellProcesses

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
        failure = not_saved = ''
        try:
            client.execute(goal.motion, goal.cycles, goal.law, check, on_feedback, learned=learned)
        except PkmError as error:  # the recorder closes the last bag at the end of the cell
            failure = str(error)
        else:
            not_saved = _save(client, goal, check)
    if failure:
        raise EndedEarlyError(failure, complete_of(client.log.bags, cell), losses_in(cell.bags))
    return client.log, read_own(client.log.bags, cell), cell.session, not_saved


def _save(client, goal, check):
    """Save the learned feedforward; return why that failed, '' if it has not: the cycles have run and are kept."""
    if not goal.save_learned:
        return ''
    try:
        client.save_learned(goal.save_learned.resolve(), check)
    except PkmError as error:
        return str(error)
    return ''


def _results(goal, cell, arrangement, hash_of_config, log, records):
    """Return the content of results.json."""
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
    counted = [entry for entry in results['messages'].values() if entry['expected'] is not None]
    recorded, expected = (sum(entry[key] for entry in counted) for key in ('recorded', 'expected'))
    lost = sum(max(0, entry['expected'] - entry['recorded']) for entry in counted)
    surplus = recorded - expected + lost
    console.print(
        f'{results["ticks"]} ticks in {len(results["cycles"])} cycles: '
        f'{results["ticks_per_second_in_cycles"]:.0f} ticks/s while moving, '
        f'{results["ticks_per_second"]:.0f} ticks/s with the pauses for learning ({results["arrangement"]})'
    )
    for notice in results['notices']:
        console.plain(notice)
    console.print(f'{recorded} messages recorded of {expected} expected: {lost} lost')
    if surplus:
        console.print(f'{surplus} messages more than expected: topics of the cell have further publishers')
    console.plain(f'bags, results.json and learning.png are in {out}')
