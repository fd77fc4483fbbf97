"""`pkm bench`: measure the servo tick against what the middleware allows, everything in turns within one run."""

import json
import os
import platform
from contextlib import ExitStack
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.recording.provenance import git_revision
from pkm_nodes.bench.subjects import FLOORS, GRAPHS, MACHINE, SUBJECTS, Subject
from pkm_nodes.bench.targets import MEMORY_STEP, ratios, targets


def bench(
    turns: Annotated[int, typer.Option(min=1, help='How often every subject is measured.')] = 9,
    cycles: Annotated[int, typer.Option(min=1, help='Learning cycles of a cell in a turn.')] = 8,
    memory_cycles: Annotated[
        int, typer.Option(min=0, help='Cycles over which the memory of the composed cell is watched; 0 for none.')
    ] = 1000,
    only: Annotated[
        list[str] | None, typer.Option(help=f'Measure only this subject; may be repeated: {", ".join(SUBJECTS)}.')
    ] = None,
    json_file: Annotated[Path | None, typer.Option('--json', help='Also write every figure to this file.')] = None,
):
    """
    Measure the servo tick: bare middleware, composed cell, processes, rclpy's executor, MuJoCo, no ROS; print ratios.

    Subjects take turns, so other work on this computer falls on all alike. Seven ROS domains from ROS_DOMAIN_ID on are
    used. Without MuJoCo that subject is left out.

    Example: `pkm bench --json runs/bench.json`
    """
    console = Console()
    begin = os.getloadavg()
    names = _names(only)
    with Progress(console=console) as progress:
        task = progress.add_task('starting', total=turns * len(names) + memory_cycles // MEMORY_STEP)
        measured = _take_turns(names, turns, cycles, lambda text: progress.update(task, description=text, advance=1))
        memory = _watch_memory(memory_cycles, lambda text: progress.update(task, description=text, advance=1))
    account = targets(measured, memory)
    figures = {
        'when': datetime.now(UTC).isoformat(timespec='seconds'),
        'revision': git_revision(),
        'computer': {
            'processor': platform.processor() or platform.machine(),
            'cores': os.cpu_count(),
            'load_before': begin,
            'load_after': os.getloadavg(),
        },
        'subjects': {name: {'what': SUBJECTS[name], **measured[name]} for name in names},
        'ratios': ratios(measured),
        'targets': [
            {
                'name': target.name,
                'value': target.value,
                'bound': target.bound,
                'at_least': target.at_least,
                'unit': target.unit,
                'met': target.met,
            }
            for target in account
        ],
        'memory_mb': memory,
    }
    if json_file:
        json_file.parent.mkdir(parents=True, exist_ok=True)
        json_file.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    console.print(_subjects_table(measured))
    console.print(_ratios_table(figures['ratios']))
    console.print(_targets_table(account))
    console.print(
        f'load of this computer: {begin[0]:.1f} before, {os.getloadavg()[0]:.1f} after; {os.cpu_count()} cores'
    )
    if not find_spec('mujoco'):
        console.print('MuJoCo is not installed: uv pip install --require-hashes -r requirements/bench.txt')


def _names(only):
    """Return the subjects to measure, in the order of the table; a floor needs the composed cell for its readers."""
    wanted = set(only or SUBJECTS)
    if wanted - set(SUBJECTS):
        raise PkmError(f'--only: {sorted(wanted - set(SUBJECTS))} given; known: {", ".join(SUBJECTS)}')
    if wanted & set(FLOORS):
        wanted.add('composed')
    return [name for name in SUBJECTS if name in wanted and (name != 'mujoco' or find_spec('mujoco'))]


def _take_turns(names, turns, cycles, advance):
    """Return {subject: {figure: [of every turn]}}."""
    samples = round(0.34 / load_machine(MACHINE).sample_time)  # about a cycle of the cells
    amounts = {'mujoco': cycles, 'simulation': 20 * cycles} | dict.fromkeys(FLOORS, cycles * samples)
    measured = {name: {} for name in names}
    first = int(os.environ.get('ROS_DOMAIN_ID', '0'))
    with ExitStack() as stack:
        subjects = {}
        for name in sorted(names, key=FLOORS.__contains__):  # the floors last: they have to be told their readers
            domain = first + GRAPHS.index(name) if name in GRAPHS else first
            readers = subjects['composed'].word()['readers'] if name in FLOORS else None
            subjects[name] = Subject(name, domain, readers)
            stack.callback(subjects[name].close)
        for subject in subjects.values():
            subject.word()
        for turn in range(turns):
            for name in names if turn % 2 else reversed(names):
                advance(f'turn {turn + 1}: {name}')
                for figure, value in subjects[name].ask('turn', amounts.get(name, cycles)).items():
                    measured[name].setdefault(figure, []).append(value)
    return measured


def _watch_memory(cycles, advance):
    """Return the memory of the composed cell [MB] after every MEMORY_STEP of `cycles` cycles."""
    if cycles < MEMORY_STEP:
        return []
    subject = Subject('composed', int(os.environ.get('ROS_DOMAIN_ID', '0')))
    try:
        subject.word()
        memory = []
        for number in range(cycles // MEMORY_STEP):
            advance(f'memory: cycle {number * MEMORY_STEP}')
            memory.append(subject.ask('memory', MEMORY_STEP)['memory_mb'])
        return memory
    finally:
        subject.close()


def _subjects_table(measured):
    real_time = 1.0 / load_machine(MACHINE).sample_time
    table = Table(title=f'{MACHINE}: ticks per second ({real_time:.0f} are real time)')
    for heading in ('', 'median', 'best', 'x real time', 'CPU \\[us a tick]'):
        table.add_column(heading, justify='right' if heading else 'left', no_wrap=not heading)
    for name, figures in measured.items():
        speeds = figures['ticks_per_second']
        table.add_row(
            SUBJECTS[name],
            f'{median(speeds):.0f}',
            f'{max(speeds):.0f}',
            f'{max(speeds) / real_time:.2f}',
            f'{median(figures["cpu_us_per_tick"]):.0f}',
        )
    return table


def _ratios_table(pairs):
    table = Table(title='how many times as fast, medians of the turns')
    for heading in ('', 'by ticks/s', 'by CPU time'):
        table.add_column(heading, justify='right' if heading else 'left', no_wrap=not heading)
    for name, pair in pairs.items():
        table.add_row(name, f'{pair["ticks_per_second"]:.2f}', f'{pair["processor_time"]:.2f}')
    return table


def _targets_table(account):
    table = Table(title='to reach')
    for heading in ('', 'measured', 'wanted', 'reached'):
        table.add_column(heading, justify='right' if heading else 'left', no_wrap=True)
    for target in account:
        name = f'{target.name} \\[{target.unit}]' if target.unit else target.name
        value = '' if target.value is None else f'{target.value:.2f}'
        bound = f'{"at least" if target.at_least else "at most"} {target.bound:g}'
        table.add_row(name, value, bound, {True: 'yes', False: 'no', None: '-'}[target.met])
    return table
