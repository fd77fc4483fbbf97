"""`pkm experiment`: the experiments of chapters 7 and 8 of the thesis, repeated beside its values."""

from contextlib import contextmanager
from enum import StrEnum
from typing import Annotated

import typer

from pkm_core.arrangement import Arrangement
from pkm_core.errors import PkmError
from pkm_core.files import write_text
from pkm_core.verbs.console import Output, progress_bar, report_table
from pkm_core.verbs.options import (
    ArrangementOption,
    ClusterOption,
    JsonOption,
    OutOption,
    OverwriteOption,
    ProcessesOption,
    out_folder,
    write_figures,
)


class What(StrEnum):
    """The experiment: a chapter of the thesis, targets, constants of the learned error, laws, heat, stage, modes."""

    planar = 'planar'
    four_dof = 'four_dof'
    targets = 'targets'
    sensitivity = 'sensitivity'
    structures = 'structures'
    drift = 'drift'
    stage = 'stage'
    flexible = 'flexible'


def experiment(
    what: Annotated[
        What,
        typer.Argument(
            help='Chapter 7, chapter 8, targets, sensitivity to the constants, PID beside observer, heat, claim '
            'against the XY stage, flexible modes.'
        ),
    ],
    seeds: Annotated[int, typer.Option(min=1, help='Number of noise seeds, counted from 1.')] = 5,
    cycles: Annotated[
        int, typer.Option(min=1, help='Evaluated cycles per run, after those in which learning converges.')
    ] = 10,
    arrangement: ArrangementOption = Arrangement.simulation,
    processes: ProcessesOption = 0,
    cluster: ClusterOption = '',
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Compare XY stage, computed torque, robust control and learning, with the spread over cycles and noise seeds.

    `planar` prints Tables 7.2 to 7.5 and `four_dof` Tables 8.2 and 8.3; --out adds their figures and tables.md.
    End-point errors are measured by the laser. `targets` lists each target and whether it was met. `sensitivity` shows
    how the learned error depends on each chosen constant of the simulated machine; --out adds its figure. `structures`
    compares PID and observer over 40 cycles, on models as shipped, on identified ones, and on random machines. `drift`
    warms machines up by an hour of moves and shows the drift of the end point, with and without recalibration and
    learning; --out adds its figure. `stage` varies the assumptions about the XY stage and shows where it settles later
    than the planar machine, as the thesis reports; --out adds its figure. `flexible` compares modes in series with
    modes that react on the machine: margins and errors. Every arrangement gives the same bits;
    --processes and --cluster apply to the simulation.

    Example: `pkm experiment planar --out runs/planar --json planar.json`

    Example: `pkm experiment four_dof --seeds 1 --arrangement composed`

    Example: `pkm experiment targets`

    Example: `pkm experiment sensitivity --out runs/sensitivity`

    Example: `pkm experiment structures --seeds 1`

    Example: `pkm experiment drift --seeds 2 --out runs/drift`

    Example: `pkm experiment stage --out runs/stage`

    Example: `pkm experiment flexible`
    """
    from pkm_core.experiments.report import markdown

    console, out = Output(), out_folder(out)
    workers = processes, cluster
    if what not in (What.planar, What.four_dof) and arrangement is not Arrangement.simulation:
        raise PkmError(f'--arrangement: {arrangement} given; {what} runs in simulation only')
    if what is What.targets:
        tables, figures = _targets(console, seeds, cycles, workers)
    elif what is What.sensitivity:
        tables, figures = _sensitivity(console, seeds, cycles, workers, out)
    elif what is What.structures:
        tables, figures = _structures(console, seeds, workers)
    elif what is What.drift:
        tables, figures = _drift(console, seeds, cycles, workers, out)
    elif what is What.stage:
        tables, figures = _stage(console, seeds, cycles, workers, out)
    elif what is What.flexible:
        tables, figures = _flexible(console, seeds, cycles, workers)
    else:
        tables, figures = _study(console, what.value, arrangement, seeds, cycles, workers, out)
    for table in tables:
        console.print(report_table(table, align='l'))
    if out:
        write_text(out / 'tables.md', '\n'.join(markdown(table) for table in tables))
        console.plain(f'tables.md and figures are in {out}')
    write_figures(json_file, figures)


def _study(console, what, arrangement, seeds, cycles, workers, out):
    """Run a chapter and return its tables and figures; `workers` is (--processes, --cluster)."""
    from pkm_core.experiments.condition import conditions, prepared
    from pkm_core.experiments.figures import plot_study
    from pkm_core.experiments.graph_driver import graph_driver
    from pkm_core.experiments.report import study_report
    from pkm_core.experiments.runs import measure
    from pkm_core.experiments.study import run_study

    def simulate(runs, cycles):
        tasks = [(measure, condition, seed, cycles) for condition, seed in runs]
        return _farm(console, tasks, workers)

    def on_graph(runs, cycles):
        with _progress(console, len(runs)) as on_done:
            return graph_driver()(runs, cycles, arrangement.value, out, on_done)

    for law in filter(None, (prepared(condition).law for condition in conditions(what))):
        console.print(law.verdict, markup=False, highlight=False)
    execute = simulate if arrangement is Arrangement.simulation else on_graph
    study = run_study(what, arrangement.value, execute, seeds, cycles)
    if out:
        plot_study(study, out)
    return study_report(study)


def _targets(console, seeds, cycles, workers):
    """Run what the targets need and return their table and figures."""
    from pkm_core.experiments.report import targets_report
    from pkm_core.experiments.targets import target_tasks, targets

    tasks = target_tasks(seeds, cycles)
    results = _farm(console, list(tasks.values()), workers)
    return targets_report(targets(dict(zip(tasks, results, strict=True))), seeds, cycles)


def _sensitivity(console, seeds, cycles, workers, out):
    """Run each constant at its levels and return the tables and figures."""
    from pkm_core.experiments.sensitivity import sensitivity, sensitivity_report, sensitivity_tasks
    from pkm_core.experiments.sensitivity_figure import draw_sensitivity

    tasks = sensitivity_tasks(seeds, cycles)
    found = sensitivity(dict(zip(tasks, _farm(console, list(tasks.values()), workers), strict=True)))
    if out:
        draw_sensitivity(out, found)
    return sensitivity_report(found, seeds, cycles)


def _structures(console, seeds, workers):
    """Run both structures on all machines and return their table and figures."""
    from pkm_core.experiments.structures import structure_tasks, structures_report

    tasks = structure_tasks(seeds)
    results = _farm(console, list(tasks.values()), workers)
    return structures_report(dict(zip(tasks, results, strict=True)), seeds)


def _drift(console, seeds, cycles, workers, out):
    """Run the hour on all machines and return the tables and figures."""
    from pkm_core.experiments.drift import drift_tasks
    from pkm_core.experiments.drift_figure import draw_drift
    from pkm_core.experiments.drift_report import drift_report

    tasks = drift_tasks(seeds, cycles)
    found = dict(zip(tasks, _farm(console, list(tasks.values()), workers), strict=True))
    if out:
        draw_drift(out, found)
    return drift_report(found, seeds, cycles)


def _stage(console, seeds, cycles, workers, out):
    """Tune the stage for every first mode, run it under all assumptions and return the tables and figures."""
    from pkm_core.experiments.stage_assumptions import tuned
    from pkm_core.experiments.stage_claim import claim, claim_tasks, loops
    from pkm_core.experiments.stage_report import draw_stage, stage_report
    from pkm_core.parallel import search_executor
    from pkm_core.tuning.config import load_tuning

    search, gains = load_tuning().search, {}
    total = search.generations * search.restarts
    with progress_bar(console, total * len(loops()), name='generations') as bar, search_executor(*workers) as executor:
        for number, loop in enumerate(loops()):
            gains[loop] = tuned(loop, executor, lambda done, before=total * number: bar.show(before + done))
    tasks = claim_tasks(gains, seeds, cycles)
    found = claim(dict(zip(tasks, _farm(console, list(tasks.values()), workers), strict=True)))
    if out:
        draw_stage(out, found)
    return stage_report(found, seeds, cycles)


def _flexible(console, seeds, cycles, workers):
    """Run modes in series and modes that react, and return their table and figures."""
    from pkm_core.experiments.flexible import flexible_report, flexible_tasks

    tasks = flexible_tasks(seeds, cycles)
    results = _farm(console, list(tasks.values()), workers)
    return flexible_report(dict(zip(tasks, results, strict=True)), seeds, cycles)


def _farm(console, tasks, workers):
    """Return the results of `tasks`, run without ROS by the processes or the cluster of `workers`."""
    from pkm_core.experiments.runs import farm
    from pkm_core.parallel import search_executor

    with _progress(console, len(tasks)) as on_done, search_executor(*workers) as executor:
        return farm(executor, tasks, on_done)


@contextmanager
def _progress(console, total):
    """Show a bar; yields a function that takes the number of finished runs and the name of the last one."""
    with progress_bar(console, total, name='runs') as bar:
        yield lambda done, what='runs': bar.show(done, what)
