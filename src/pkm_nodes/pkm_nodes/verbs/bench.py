"""`pkm bench`: measure the rate of the servo tick against the limit of the middleware, subjects in turns."""

import os
import platform
from contextlib import ExitStack
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.util import find_spec
from statistics import median
from typing import Annotated

import typer

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.recording.provenance import git_revision
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.options import JsonOption, OverwriteOption, write_figures
from pkm_nodes.bench.subjects import FLOORS, GRAPHS, MACHINE, SUBJECTS, Subject
from pkm_nodes.bench.targets import MEMORY_STEP, ratios, targets
from pkm_nodes.clients.machine_watch import FIGURES


def _subjects(incomplete: str):
    """Return the subjects, for completion."""
    return [name for name in SUBJECTS if name.startswith(incomplete)]


def bench(
    turns: Annotated[int, typer.Option(min=1, help='Number of turns; every subject is measured once per turn.')] = 9,
    cycles: Annotated[int, typer.Option(min=1, help='Learning cycles of a cell per turn.')] = 8,
    memory_cycles: Annotated[
        int, typer.Option(min=0, help='Cycles over which the memory of the composed cell is measured; 0: none.')
    ] = 1000,
    only: Annotated[
        list[str] | None,
        typer.Option(autocompletion=_subjects, help=f'Measure only this subject, repeatable: {", ".join(SUBJECTS)}.'),
    ] = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Measure the servo tick: bare middleware, composed cell, processes, rclpy's executor, MuJoCo, no ROS; print ratios.

    Subjects take turns, so that other load of this computer affects all of them equally. Uses eight ROS domains from
    ROS_DOMAIN_ID upwards. The subject MuJoCo is left out if it is not installed.

    Example: `pkm bench --json runs/bench.json`

    Example: `pkm bench --only pace --turns 9 --cycles 10 --memory-cycles 0`
    """
    console = Output()
    begin = os.getloadavg()
    names = _names(only)
    steps = turns * len(names) + memory_cycles // MEMORY_STEP
    with progress_bar(console, steps, name='starting', keep=True) as bar:
        measured = _take_turns(names, turns, cycles, bar.step)
        memory = _watch_memory(memory_cycles, bar.step)
    account = targets(measured, memory)
    console.print(_subjects_table(measured))
    console.print(_ratios_table(ratios(measured)))
    if 'pace' in measured:
        console.print(_pace_table(measured['pace']))
    console.print(_targets_table(account))
    console.print(
        f'load of this computer: {begin[0]:.1f} before, {os.getloadavg()[0]:.1f} after; {os.cpu_count()} cores'
    )
    if not find_spec('mujoco'):
        console.print('MuJoCo is not installed: uv pip install --require-hashes -r requirements/bench.txt')
    write_figures(json_file, _figures(names, measured, memory, account, begin))


def _figures(names, measured, memory, account, load_before):
    """Return the content of the JSON file."""
    return {
        'when': datetime.now(UTC).isoformat(timespec='seconds'),
        'revision': git_revision(),
        'computer': {
            'processor': platform.processor() or platform.machine(),
            'cores': os.cpu_count(),
            'load_before': load_before,
            'load_after': os.getloadavg(),
        },
        'subjects': {name: {'what': SUBJECTS[name], **measured[name]} for name in names},
        'ratios': ratios(measured),
        'targets': [{**asdict(target), 'met': target.met} for target in account],
        'memory_mb': memory,
    }


def _names(only):
    """Return the subjects to measure, in the order of the table; a floor needs the reader counts of `composed`."""
    wanted = set(only or SUBJECTS)
    if wanted - set(SUBJECTS):
        raise PkmError(f'--only: {sorted(wanted - set(SUBJECTS))} given; allowed: {", ".join(SUBJECTS)}')
    if wanted & set(FLOORS):
        wanted.add('composed')
    return [name for name in SUBJECTS if name in wanted and (name != 'mujoco' or find_spec('mujoco'))]


def _take_turns(names, turns, cycles, advance):
    """Return {subject: {figure: [value of each turn]}}; `advance(text)` begins each measurement."""
    samples = round(0.34 / load_machine(MACHINE).sample_time)  # about one cycle of the cells
    amounts = {'mujoco': cycles, 'simulation': 20 * cycles} | dict.fromkeys(FLOORS, cycles * samples)
    measured = {name: {} for name in names}
    first = int(os.environ.get('ROS_DOMAIN_ID', '0'))
    with ExitStack() as stack:
        subjects = {}
        for name in sorted(names, key=FLOORS.__contains__):  # floors need the reader counts
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
    """Return the memory of the composed cell [MB], one value per MEMORY_STEP of `cycles` cycles."""
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
    rows = []
    for name, figures in measured.items():
        speeds = figures['ticks_per_second']
        rows.append(
            (
                SUBJECTS[name],
                f'{median(speeds):.0f}',
                f'{max(speeds):.0f}',
                f'{max(speeds) / real_time:.2f}',
                f'{median(figures["cpu_us_per_tick"]):.0f}',
            )
        )
    title = f'{MACHINE}: ticks per second ({real_time:.0f} are real time)'
    return table(title, ['', 'median', 'best', 'x real time', 'CPU [us per tick]'], rows)


def _ratios_table(pairs):
    rows = [(name, f'{pair["ticks_per_second"]:.2f}', f'{pair["processor_time"]:.2f}') for name, pair in pairs.items()]
    return table('how many times as fast, medians of the turns', ['', 'by ticks/s', 'by CPU time'], rows)


def _pace_table(figures):
    rows = [(name, *(f'{each(figures[name]):.3f}' for each in (min, median, max))) for name in ('reached', *FIGURES)]
    return table('composed cell at pace 1.0, per turn', ['', 'smallest', 'median', 'largest'], rows)


def _targets_table(account):
    rows = []
    for target in account:
        name = f'{target.name} [{target.unit}]' if target.unit else target.name
        value = '' if target.value is None else f'{target.value:.2f}'
        bound = f'{"at least" if target.at_least else "at most"} {target.bound:g}'
        rows.append((name, value, bound, {True: 'yes', False: 'no', None: '-'}[target.met]))
    return table('targets', ['', 'measured', 'wanted', 'reached'], rows, no_wrap=True)
