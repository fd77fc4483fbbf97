"""`pkm run`: start a cell, drive a motion for some learning cycles, and report what the bags say."""

import json
import os
from datetime import datetime
from enum import StrEnum
from math import isnan, nan
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import writable_folder
from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.errors import PkmError
from pkm_core.learning import law_file, law_names
from pkm_core.learning.initial import first_feedforward
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.recording.provenance import config_hash, loop_hash, machine_hash
from pkm_core.reporting.figures import plot_cycles
from pkm_core.reporting.summary import cycle_figures, cycles_table, messages
from pkm_nodes.graph import ENVIRONMENTS, NAMESPACE, cell_nodes, namespace_of

_LAW = 'fourier_pid'


class Arrangement(StrEnum):
    """How the nodes are spread over processes."""

    composed = 'composed'
    processes = 'processes'


def run(
    machine: Annotated[str, typer.Option(help='Machine of config/machines, or a YAML file.')] = 'four_dof',
    motion: Annotated[
        str, typer.Option(help="Motion of config/motions, or a YAML file; '' is the machine's own.")
    ] = '',
    cycles: Annotated[int, typer.Option(min=1, help='Learning cycles.')] = 12,
    law: Annotated[
        str,
        typer.Option(
            help=f'Learning law: none, {", ".join(law_names())}; or a YAML file. By default {_LAW}, where the control '
            'learns.'
        ),
    ] = '',
    control: Annotated[
        str,
        typer.Option(
            help="'robust', 'computed_torque', a file of config/control or its folder computed_torque, or a YAML file."
        ),
    ] = 'robust',
    learned: Annotated[
        Path | None, typer.Option(help='Begin with the feedforward of this file, which --save-learned wrote.')
    ] = None,
    save_learned: Annotated[Path | None, typer.Option(help='Save the best learned feedforward to this file.')] = None,
    seed: Annotated[int, typer.Option(min=0, help='Seed of everything random in the machine.')] = 1,
    environment: Annotated[str, typer.Option(help=f'{ENVIRONMENTS.capitalize()}.')] = 'nominal',
    namespace: Annotated[
        str, typer.Option(help='Where the cell lives in the graph; cells in different namespaces do not meet.')
    ] = NAMESPACE,
    arrangement: Annotated[Arrangement, typer.Option(help='One process, or one a node.')] = Arrangement.composed,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar='NODE', help='Leave out this node, others take its place; may be given several times.'),
    ] = None,
    out: Annotated[Path | None, typer.Option(help='Folder for results; a new one in runs/ by default.')] = None,
    json_file: Annotated[Path | None, typer.Option('--json', help='Also write the results to this file.')] = None,
):
    """
    Drive a motion for some learning cycles on the real ROS 2 graph.

    Writes one MCAP bag a cycle, results.json and learning.png into --out, and prints first against last cycle.

    Example: `pkm run --cycles 12 --law fourier_pid --arrangement processes`

    Example: `pkm run --without joint_controller_d3`
    """
    console = Console()
    namespace = namespace_of(namespace)
    model = load_machine(machine)
    motion = motion or default_motion(model)
    joints = to_joints(model, plan(model, load_motion(motion)))  # what cannot be driven starts no process
    gains = choose_control(model, control)
    kind = kind_of(gains)
    law = law or (_LAW if kind == 'robust' else 'none')
    if law != 'none':
        law_file(law)
        if kind != 'robust':
            raise PkmError(f'--law: {law!r} given; --control {control} learns nothing, expected none')
    elif save_learned:
        raise PkmError('--save-learned: --law none learns nothing')
    if learned:
        first_feedforward(learned, model, Path(motion).stem, law, gains, joints)
    goal = {'motion': motion, 'cycles': cycles, 'law': law, 'learned': learned.resolve() if learned else ''}
    cell = {'control': control, 'seed': seed, 'environment': environment, 'without': without or []}
    cell_nodes(machine, control=control, without=cell['without'])  # refuses what is unknown before anything starts
    out = writable_folder(out or Path('runs') / f'{datetime.now():%Y%m%dT%H%M%S}_{model.name}')
    if (out / 'results.json').exists():
        raise PkmError(f'--out: {out} holds the results of another run; name an empty folder')

    try:
        log = _drive(console, machine, arrangement.value, namespace, cell, goal, out, save_learned)
    except PkmError as error:
        raise PkmError(f'{error}\nwhat the cell printed and recorded is in {out}') from None
    records = [read_cycle(path) for path in log.bags]
    results = {
        'machine': model.name,
        'motion': Path(motion).stem,
        'law': law,
        'learned': str(learned) if learned else None,
        **cell,
        'without': ', '.join(cell['without']),  # a text, as reports show it
        'arrangement': arrangement.value,
        'config_hash': config_hash([loop_hash(model, control, machine_hash(machine))], motion, law),
        'sample_time_s': model.sample_time,
        'ticks': log.ticks,
        'ticks_per_second': log.ticks / log.seconds,
        'ticks_per_second_in_cycles': log.ticks / log.seconds_in_cycles,
        'messages': messages(records),
        'notices': log.notices,
        'cycles': [{'cycle': r.cycle, 'bag': r.path.name, 'axes': cycle_figures(r)} for r in records],
    }
    text = json.dumps(results, indent=2)
    for path in filter(None, (out / 'results.json', json_file)):
        path.write_text(text + '\n', encoding='utf-8')
    plot_cycles(records, out / 'learning.png')
    console.print(cycles_table(model.name, records))
    _print_account(console, results, out)


def _drive(console, machine, arrangement, namespace, cell_options, goal, out, save_learned):
    """Run the cell and return its `CycleLog`."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    from pkm_nodes.clients.cell_client import CellClient
    from pkm_nodes.clients.cell_processes import CellProcesses

    progress = Progress(
        TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), console=console
    )
    with (
        progress,
        CellProcesses(machine, arrangement, namespace=namespace, **cell_options, folder=out) as cell,
        CellClient(namespace) as client,
    ):
        task = progress.add_task('starting the cell', total=goal['cycles'])
        check = cell.check
        if cell.left_out:
            progress.update(task, description='waiting for others in the place of nodes left out')
            check = client.wait_for_others(
                cell, lambda text: progress.console.print(text, soft_wrap=True, markup=False)
            )
        client.wait_until_up(check)
        what = f'{Path(goal["motion"]).stem}, law {goal["law"]}'
        progress.update(task, description=what)

        def on_feedback(feedback):
            worst = max((e for e in feedback.max_dynamic_error if not isnan(e)), default=nan) * 1e6
            progress.update(
                task,
                completed=feedback.cycle,
                description=f'{what}: worst axis {worst:5.1f} um',
            )

        log = client.execute(**goal, check=check, on_feedback=on_feedback)
        if save_learned:
            client.save_learned(save_learned.resolve(), check)
        return log


def _print_account(console, results, out):
    counted = [entry for entry in results['messages'].values() if entry['expected'] is not None]
    recorded, expected = (sum(entry[key] for entry in counted) for key in ('recorded', 'expected'))
    console.print(
        f'{results["ticks"]} ticks in {len(results["cycles"])} cycles: '
        f'{results["ticks_per_second_in_cycles"]:.0f} ticks/s while moving, '
        f'{results["ticks_per_second"]:.0f} ticks/s with the pauses for learning ({results["arrangement"]})'
    )
    for notice in results['notices']:
        console.print(notice)
    console.print(f'{recorded} messages recorded of {expected} expected: {expected - recorded} lost')
    console.print(f'bags, results.json and learning.png are in {out}', soft_wrap=True)
