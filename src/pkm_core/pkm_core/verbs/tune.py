"""`pkm tune`: search the gains of the robust controllers of a machine."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pkm_core.machines import load_machine
from pkm_core.verbs.options import JsonOption, MachineOption, SeedOption, write_json


def tune(
    out: Annotated[Path, typer.Option(help='Folder for the recommended gains, all candidates and pictures.')],
    machine: MachineOption = 'four_dof',
    tuning: Annotated[str, typer.Option(help='Targets and limits of config/tuning, or a YAML file.')] = 'robust',
    seed: SeedOption = 1,
    processes: Annotated[int, typer.Option(min=0, help='How many at once; 0 is one a processor.')] = 0,
    cluster: Annotated[str, typer.Option(help='Address of a dask scheduler that runs the search instead.')] = '',
    resume: Annotated[Path | None, typer.Option(help='Go on with this search.npz.')] = None,
    json_file: JsonOption = None,
):
    """
    Tune every axis of a machine by a genetic algorithm on objective (7.30), with margins as limits.

    Writes OUT/<machine>.yaml, which `--control` and the nodes load, OUT/search.npz with every candidate's figures (what
    an interrupted search resumes from), OUT/table.md in the form of Tables 7.1 and 8.1, and a picture an axis. The same
    seed gives the same gains in any number of processes.

    Example: `pkm tune --machine four_dof --out runs/tune`

    Example: `pkm tune --resume runs/tune/search.npz --out runs/tune`
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from pkm_core.control.margin_plots import model_loops, plot_margins
    from pkm_core.parallel import search_executor
    from pkm_core.thesis.gains import table_markdown
    from pkm_core.tuning.config import load_tuning
    from pkm_core.tuning.tune import tune as run
    from pkm_core.verbs.margins import margins_table

    console, system, config = Console(), load_machine(machine), load_tuning(tuning)
    total = config.search.generations * config.search.restarts
    columns = (TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as bar, search_executor(processes, cluster) as executor:
        tasks = {joint: bar.add_task(f'{joint} generations', total=total) for joint in system.joints}

        def on_progress(branches):
            for joint, task in tasks.items():
                done = sum(branch.generations for branch in branches if branch.joint == joint)
                bar.update(task, completed=min(done, total))

        found = run(system, config, seed, executor, out, resume=resume, on_progress=on_progress)
    console.print(
        margins_table(f'{system.name}, tuned', {j: {'nominal': a.margins, 'worst': a.worst} for j, a in found.items()})
    )
    table = {joint: axis.column for joint, axis in found.items()}
    (out / 'table.md').write_text(table_markdown(system.name, table), encoding='utf-8')
    for joint, axis in found.items():
        loops = model_loops(axis.gains, axis.model, system.sample_time)
        plot_margins(out / f'margins_{joint}.png', f'{system.name} {joint}, tuned; thin: perturbed models', *loops)
    console.print(_objectives(found))
    console.print(f'gains are in {out / system.name}.yaml, the rest beside it', soft_wrap=True)
    write_json(
        json_file,
        {
            'machine': system.name,
            'seed': seed,
            'control': str(out / f'{system.name}.yaml'),
            'axes': {
                joint: {
                    'objective': axis.objective,
                    'candidates': axis.candidates,
                    'gains': axis.gains.model_dump(),
                    'nominal': asdict(axis.margins),
                    'worst': asdict(axis.worst),
                }
                for joint, axis in found.items()
            },
        },
    )


def _objectives(found):
    table = Table(title='objective (7.30)', title_justify='left')
    for heading in ('axis', 'J', 'candidates'):
        table.add_column(heading, justify='left' if heading == 'axis' else 'right')
    for joint, axis in found.items():
        table.add_row(joint, f'{axis.objective:.4f}', str(axis.candidates))
    return table
