"""`pkm commission`: from a machine nobody knows to a learned motion, in one command."""

import os
from contextlib import contextmanager
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from time import monotonic
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from pkm_core.bag.reader import writable_folder
from pkm_core.learning import law_file, law_names
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.verbs.options import JsonOption, MachineOption, SeedOption, write_json


class Arrangement(StrEnum):
    """Where the machine and its controllers run."""

    composed = 'composed'
    processes = 'processes'
    simulation = 'simulation'


def commission(
    machine: MachineOption = 'four_dof',
    specimen: Annotated[
        int, typer.Option(min=0, help='Number of the unknown machine: same number, same machine; 0 is that of config.')
    ] = 1,
    motion: Annotated[
        str, typer.Option(help="Motion of config/motions, or a YAML file; '' is the machine's own.")
    ] = '',
    law: Annotated[str, typer.Option(help=f'Learning law: {", ".join(law_names())}; or a YAML file.')] = 'inverse',
    cycles: Annotated[int, typer.Option(min=1, help='Learning cycles.')] = 8,
    accept: Annotated[float, typer.Option(min=0.0, help='Largest dynamic error in the acceptance move [um].')] = 50.0,
    tuning: Annotated[str, typer.Option(help='Targets and limits of config/tuning, or a YAML file.')] = 'robust',
    seed: SeedOption = 1,
    environment: Annotated[str, typer.Option(help='How rough the world is: a section of config/truth.')] = 'nominal',
    arrangement: Annotated[
        Arrangement, typer.Option(help='The graph in one process or one a node, or the simulation without ROS.')
    ] = Arrangement.composed,
    out: Annotated[Path | None, typer.Option(help='Folder for results; a new one in runs/ by default.')] = None,
    json_file: JsonOption = None,
):
    """
    Commission a machine: identify, tune, check on the measured response, apply, accept, learn, report.

    Nothing is kept that fails: then the old gains come back, the report says why, and the command ends with code 1.
    Writes report.html, OUT/config with the model and the gains (`PKM_CONFIG=OUT/config pkm run` goes on with them),
    bags, pictures, and the search.

    Example: `pkm commission --machine four_dof --specimen 7 --out runs/commissioned`
    """
    from pkm_core.commissioning.config_copy import copy_config
    from pkm_core.commissioning.procedure import commission as run
    from pkm_core.commissioning.report import write_page
    from pkm_core.parallel import search_executor
    from pkm_core.tuning.config import load_tuning

    begun, console, system, config = monotonic(), Console(), load_machine(machine), load_tuning(tuning)
    motion = motion or default_motion(system)
    trajectory = to_joints(system, plan(system, load_motion(motion)))
    law_file(law)  # what is refused is refused before anything moves
    out = writable_folder(out or Path('runs') / f'{datetime.now():%Y%m%dT%H%M%S}_{system.name}_commissioned')
    options = {'seed': seed, 'environment': environment, 'folder': out}
    place = copy_config(system, out, environment, specimen or None)
    system = place.machine
    with (
        _bench(arrangement, machine, system, motion, trajectory, options) as bench,
        search_executor(0, '') as executor,
        _progress(console) as on_step,
    ):
        given = {'law': law, 'cycles': cycles, 'limit': 1e-6 * accept, 'seed': seed}
        story = run(system, bench, place, config, **given, executor=executor, folder=out / 'search', on_step=on_step)
    facts = {
        **{'machine': system.name, 'specimen': specimen, 'motion': Path(motion).stem, 'environment': environment},
        **{'seed': seed, 'arrangement': arrangement.value, 'law': law, 'acceptance limit [um]': accept},
        'duration [s]': round(monotonic() - begun, 1),
    }
    write_page(out / 'report.html', system, story, facts)
    figures = facts | _figures(system, story)
    for path in filter(None, (out / 'results.json', json_file)):
        write_json(path, figures)
    _show(console, system, story, out)
    if not story.accepted:
        raise typer.Exit(1)


@contextmanager
def _bench(arrangement, machine, system, motion, trajectory, options):
    """Yield the bench of an arrangement."""
    from pkm_core.commissioning.simulated_bench import SimulatedBench

    if arrangement is Arrangement.simulation:
        yield SimulatedBench(system, trajectory, **options)
        return
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    from pkm_nodes.clients.commissioning_bench import CellBench

    with CellBench(machine, system, str(motion), arrangement.value, **options) as bench:
        yield bench


@contextmanager
def _progress(console):
    """Show what is done and how much of that; yields the function `commission` tells its steps."""
    columns = (TextColumn('{task.description}'), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task('starting', total=1.0)
        yield lambda what, share: progress.update(task, description=what, completed=share)


def _show(console, system, story, out):
    """Print the tables and the outcome."""
    from pkm_core.commissioning.report import candidate_table, error_table, measured_table, model_table, verdict

    for table in (model_table(story), candidate_table(story), measured_table(story), error_table(system, story)):
        if table.rows:
            console.print(_rich(table))
    for text in story.identified.warnings:
        console.print(f'[yellow]warning:[/yellow] {escape(text)}', soft_wrap=True, highlight=False)
    for text in verdict(story):
        console.print(text, soft_wrap=True, markup=False)
    console.print(f'report.html, config, bags and pictures are in {out}', soft_wrap=True)


def _rich(table):
    """Return a `Table` of reports for the console."""
    shown = Table(title=escape(table.title), title_justify='left', box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for number, heading in enumerate(table.headings):
        shown.add_column(escape(heading), justify='right' if number > 1 else 'left')
    for row in table.rows:
        shown.add_row(*map(escape, row))
    return shown


def _figures(system, story):
    """Return every figure of a `Commissioning` as nested dicts."""

    def errors(move):
        return [dict(zip(system.joints, (1e6 * a.max_dynamic_error for a in cycle), strict=True)) for cycle in move]

    return {
        'accepted': story.accepted,
        'reasons': story.reasons,
        'not_learned': story.not_learned,
        'warnings': story.identified.warnings,
        'max_dynamic_error_um': {
            name: errors(getattr(story, name)) for name in ('as_found', 'tuned', 'restored', 'learned')
        },
        'models': {joint: model.model_dump() for joint, model in story.models.items()},
        'candidates': {
            joint: [
                {'name': each.name, 'cost': each.objective, 'recommended': each.recommended, 'beyond': each.beyond}
                for each in candidates
            ]
            for joint, candidates in story.candidates.items()
        },
        'measured_margins': {
            joint: {
                name: {'gain_margin_dB': m.gain_margin, 'phase_margin_deg': m.phase_margin, 'Smax': m.peak_sensitivity}
                for name, m in found.items()
            }
            for joint, found in story.measured.items()
        },
    }
