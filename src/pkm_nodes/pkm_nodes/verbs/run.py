"""
`pkm run`: start a cell, run a motion for a number of learning cycles, and print its figures.

Libraries are imported where they are used: a refused option or motion does not wait for compilers and figures.
"""

from pathlib import Path
from typing import Annotated

import typer

from pkm_core.arrangement import Arrangement
from pkm_core.errors import PkmError
from pkm_core.files import do_all, refused_if_unwritable, write_json
from pkm_core.servo.pace import checked_pace
from pkm_core.verbs.completion import names_of
from pkm_core.verbs.console import Output
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
from pkm_nodes.clients.run_goal import DEFAULT_LAWS, RunGoal
from pkm_nodes.graph import NAMESPACE, cell_nodes, namespace_of
from pkm_nodes.runtime.discovery import discover_on_this_computer
from pkm_nodes.verbs.run_driver import EndedEarlyError, drive


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
            help=f'{LAWS}, none; or a YAML file. Default: {DEFAULT_LAWS["robust"]} with robust controllers, '
            f'{DEFAULT_LAWS["observer"]} with observers, none with computed torque.',
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
    goal = RunGoal.checked(machine_name, motion, cycles, law, controller, learned, save_learned, learning_target)
    cell = {'control': controller, 'seed': seed, 'environment': environment, 'without': without or []}
    cell |= {'learning_target': learning_target, 'pace': checked_pace(pace, '--pace')}
    if pace and 'machine' in cell['without']:
        raise PkmError(f'--pace: {pace} given with --without machine; the machine of this cell has the pace')
    # refuses unknown names before a process starts
    options = {'seed': seed, 'environment': environment, 'without': cell['without']}
    cell_nodes(machine_name, control=controller, learning_target=learning_target, **options)
    out = run_folder(out, goal.machine.name)
    try:
        driven = drive(console, machine_name, arrangement, namespace, cell, goal, out)
    except EndedEarlyError as end:
        if end.records:
            _print_tables(console, goal.machine.name, end.records)
        for line in end.losses:
            console.plain(line)
        raise PkmError(f'{end}\nlogs and bags of the cell are in {out}') from None
    except PkmError as error:
        raise PkmError(f'{error}\nlogs and bags of the cell are in {out}') from None
    log, records = driven.log, driven.records
    hashes, expected = records.hashes, goal.hashes_of_files(machine_name, cell)
    if len(hashes) != 1 or not hashes <= expected:
        raise PkmError(
            f'{out}: the bags have the configuration {sorted(hashes)}, the files now {" or ".join(sorted(expected))}; '
            'expected files that do not change during a run'
        )
    cell['session'] = driven.session
    log.notices.extend(filter(None, [goal.still]))
    results = _results(goal, cell, arrangement, min(hashes), log, records) | {'pace': driven.pace}
    do_all(  # a full disk loses one of these, not all
        lambda: _print_tables(console, goal.machine.name, records),
        lambda: write_json(out / 'results.json', results),
        lambda: write_figures(json_file, results),
        lambda: _plot(records, out / 'learning.png'),
        lambda: _print_account(console, results, out),
        lambda: _refuse(driven.not_saved),
    )
    if driven.interrupted:
        console.plain(f'interrupted after {len(records)} of {goal.cycles} cycles; these are kept')
        raise driven.interrupted


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
        'messages': records.messages,
        'notices': log.notices,
        'cycles': records.rows,
    }


def _print_account(console, results, out):
    """Print speed, notices, recorded and expected messages."""
    from pkm_core.reporting.summary import account
    from pkm_nodes.clients.machine_watch import sentence

    console.print(
        f'{results["ticks"]} ticks in {len(results["cycles"])} cycles: '
        f'{results["ticks_per_second_in_cycles"]:.0f} ticks/s while moving, '
        f'{results["ticks_per_second"]:.0f} ticks/s with the pauses for learning ({results["arrangement"]})'
    )
    if results['pace']['asked']:
        console.plain(sentence(results['pace']))
    for notice in results['notices']:
        console.plain(notice)
    for line in account(results['messages']):
        console.plain(line)
    console.plain(f'bags, results.json and learning.png are in {out}')
