"""`pkm experiment`: chapters 7 and 8 of the thesis driven again, every figure beside its own."""

from contextlib import contextmanager
from enum import StrEnum
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pkm_core.errors import PkmError
from pkm_core.verbs.options import JsonOption, OutOption, folder, write_json


class What(StrEnum):
    """Which experiment."""

    planar = 'planar'
    four_dof = 'four_dof'
    targets = 'targets'


class Arrangement(StrEnum):
    """Where the loop is closed."""

    simulation = 'simulation'
    composed = 'composed'
    processes = 'processes'


def experiment(
    what: Annotated[What, typer.Argument(help='Chapter 7, chapter 8, or what control and learning are to reach.')],
    seeds: Annotated[int, typer.Option(min=1, help='Noise seeds: 1 to this.')] = 5,
    cycles: Annotated[int, typer.Option(min=1, help='Cycles that count of each run, after those to converge.')] = 10,
    arrangement: Annotated[
        Arrangement, typer.Option(help='Without ROS, or the ROS 2 graph in one process or one a node.')
    ] = Arrangement.simulation,
    processes: Annotated[int, typer.Option(min=0, help='Runs without ROS at once; 0 is one a processor.')] = 0,
    cluster: Annotated[str, typer.Option(help='Address of a dask scheduler for the runs without ROS.')] = '',
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Compare XY stage, computed torque, robust control and learning, with the spread over cycles and noise seeds.

    `planar` gives Tables 7.2 to 7.5, `four_dof` Tables 8.2 and 8.3, with --out also their figures and tables.md; errors
    of the end point are the laser's alone. `targets` tells which goals are reached and which are not. Every arrangement
    gives the same bits.

    Example: `pkm experiment planar --out runs/planar --json planar.json`

    Example: `pkm experiment four_dof --seeds 1 --arrangement composed`

    Example: `pkm experiment targets`
    """
    from pkm_core.experiments.report import markdown

    console, out = Console(), folder(out)
    if what is What.targets:
        tables, figures = _targets(console, arrangement, seeds, cycles, processes, cluster)
    else:
        tables, figures = _study(console, what.value, arrangement.value, seeds, cycles, processes, cluster, out)
    for table in tables:
        console.print(_rich(table))
    if out:
        (out / 'tables.md').write_text('\n'.join(markdown(table) for table in tables), encoding='utf-8')
        console.print(f'tables.md and figures are in {out}', soft_wrap=True)
    write_json(json_file, figures)


def _study(console, what, arrangement, seeds, cycles, processes, cluster, out):
    from pkm_core.experiments.condition import conditions, prepared
    from pkm_core.experiments.figures import plot_study
    from pkm_core.experiments.graph_driver import graph_driver
    from pkm_core.experiments.report import study_report
    from pkm_core.experiments.runs import farm, measure
    from pkm_core.experiments.study import run_study
    from pkm_core.parallel import search_executor

    def simulate(runs, cycles):
        tasks = [(measure, condition, seed, cycles) for condition, seed in runs]
        with _progress(console, len(tasks)) as on_done, search_executor(processes, cluster) as executor:
            return farm(executor, tasks, on_done)

    def on_graph(runs, cycles):
        with _progress(console, len(runs)) as on_done:
            return graph_driver()(runs, cycles, arrangement, out, on_done)

    for law in filter(None, (prepared(condition).law for condition in conditions(what))):
        console.print(law.verdict, markup=False, highlight=False)
    study = run_study(what, arrangement, simulate if arrangement == 'simulation' else on_graph, seeds, cycles)
    if out:
        plot_study(study, out)
    return study_report(study)


def _targets(console, arrangement, seeds, cycles, processes, cluster):
    from pkm_core.experiments.report import targets_report
    from pkm_core.experiments.runs import farm
    from pkm_core.experiments.targets import target_tasks, targets
    from pkm_core.parallel import search_executor

    if arrangement is not Arrangement.simulation:
        raise PkmError(f'--arrangement: {arrangement.value} given; targets are driven in simulation')
    tasks = target_tasks(seeds, cycles)
    with _progress(console, len(tasks)) as on_done, search_executor(processes, cluster) as executor:
        results = farm(executor, list(tasks.values()), on_done)
    return targets_report(targets(dict(zip(tasks, results, strict=True))), seeds, cycles)


@contextmanager
def _progress(console, total):
    """Show a bar; yields a function that takes the number of runs done and what was done last."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task('runs', total=total)
        yield lambda done, what='runs': bar.update(task, completed=done, description=what)


def _rich(table):
    made = Table(title=escape(table.title), title_justify='left')
    for heading in table.headings:
        made.add_column(escape(heading))
    for row in table.rows:
        made.add_row(*map(escape, row))
    return made
