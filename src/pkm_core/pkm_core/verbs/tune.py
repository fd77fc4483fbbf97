"""`pkm tune`: search for the gains of the robust controllers of a machine."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer

from pkm_core.errors import PkmError
from pkm_core.files import writable_folder, write_text
from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, progress_bars, table
from pkm_core.verbs.margins import margins_table
from pkm_core.verbs.options import (
    ClusterOption,
    JsonOption,
    MachineOption,
    OverwriteOption,
    ProcessesOption,
    SeedOption,
    TuningOption,
    require_empty,
    write_figures,
)


def tune(
    out: Annotated[Path, typer.Option(help='Folder for the recommended gains, all candidates and figures.')],
    machine_name: MachineOption = 'four_dof',
    structure: Annotated[
        Literal['pid', 'observer'],
        typer.Option(help='Law of the axes: PID with lag and notch, or Kalman filter and LQR.'),
    ] = 'pid',
    tuning: TuningOption = '',
    seed: SeedOption = 1,
    processes: ProcessesOption = 0,
    cluster: ClusterOption = '',
    resume: Annotated[Path | None, typer.Option(help='Continue the search of this search.npz.')] = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Tune every axis of a machine by a genetic algorithm: objective (7.30), stability margins as constraints.

    `--structure observer` searches the weights of the observer law; its objective is the last term of (7.30)'s, the
    response to a step of force.

    Writes OUT/<machine>.yaml, which `--controller` and the nodes load; OUT/search.npz with the figures of every
    candidate, from which an interrupted search resumes; OUT/table.md in the form of Tables 7.1 and 8.1; one figure per
    axis. The same seed gives the same gains in any number of processes.

    Example: `pkm tune --machine four_dof --out runs/tune`

    Example: `pkm tune --structure observer --machine planar --out runs/observer`

    Example: `pkm tune --resume runs/tune/search.npz --out runs/tune`
    """
    from pkm_core.parallel import search_executor
    from pkm_core.tuning.config import STRUCTURES, load_tuning, structure_of
    from pkm_core.tuning.tune import tune as run

    console, machine, config = Output(), load_machine(machine_name), load_tuning(tuning or STRUCTURES[structure])
    if structure_of(config) != structure:
        raise PkmError(
            f'--tuning: {tuning!r} is for the structure {structure_of(config)!r}; --structure {structure} given'
        )
    if not (resume or overwrite):
        require_empty(out)
    writable_folder(out)  # found before the search
    total = config.search.generations * config.search.restarts
    names = [f'{joint} generations' for joint in machine.joints]
    with progress_bars(console, names, total, keep=True) as bars, search_executor(processes, cluster) as executor:

        def on_progress(branches):
            for joint, bar in zip(machine.joints, bars, strict=True):
                done = sum(branch.generations for branch in branches if branch.joint == joint)
                bar.show(min(done, total))

        found = run(machine, config, seed, executor, out, resume=resume, on_progress=on_progress)
    console.print(
        margins_table(f'{machine.name}, tuned', {j: {'nominal': a.margins, 'worst': a.worst} for j, a in found.items()})
    )
    _write_files(out, machine, found)
    console.print(_objectives(found))
    console.plain(f'gains are in {out / machine.name}.yaml; search.npz and figures are beside it')
    write_figures(
        json_file,
        {
            'machine': machine.name,
            'seed': seed,
            'control': str(out / f'{machine.name}.yaml'),
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


def _write_files(out, machine, found):
    """Write table.md and one figure per axis into `out`."""
    from pkm_core.control.margin_plots import model_loops, plot_margins
    from pkm_core.thesis.gains import table_markdown

    columns = {joint: axis.column for joint, axis in found.items() if axis.column}
    if columns:
        write_text(out / 'table.md', table_markdown(machine.name, columns))
    for joint, axis in found.items():
        loops = model_loops(axis.gains, axis.model, machine.sample_time)
        plot_margins(out / f'margins_{joint}.png', f'{machine.name} {joint}, tuned; thin: perturbed models', *loops)


def _objectives(found):
    rows = [(joint, f'{axis.objective:.4f}', str(axis.candidates)) for joint, axis in found.items()]
    return table('objective', ['axis', 'J', 'candidates'], rows)
