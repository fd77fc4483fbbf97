"""`pkm commission`: take an unknown machine to a learned motion."""

from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Annotated

import typer

from pkm_core.arrangement import Arrangement
from pkm_core.design.specimen import LINKS
from pkm_core.files import do_all, write_json
from pkm_core.learning import law_file
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.verbs.console import Output, progress_bar, report_table
from pkm_core.verbs.options import (
    ArrangementOption,
    CyclesOption,
    EnvironmentOption,
    JsonOption,
    LawOption,
    MachineOption,
    MotionOption,
    OverwriteOption,
    RunFolderOption,
    SeedOption,
    TuningOption,
    run_folder,
    write_figures,
)
from pkm_nodes.runtime.discovery import discover_on_this_computer


def commission(
    machine_name: MachineOption = 'four_dof',
    truth_seed: Annotated[
        int,
        typer.Option(
            '--specimen',
            min=0,
            help='Number of a random machine; the same number gives the same machine. 0: the machine of config.',
        ),
    ] = 1,
    motion: MotionOption = '',
    law: LawOption = 'inverse',
    cycles: CyclesOption = 8,
    accept: Annotated[
        float, typer.Option(min=0.0, help='Largest accepted dynamic error of the acceptance move [um].')
    ] = 50.0,
    calibrate: Annotated[
        bool, typer.Option(help='Measure the lengths of the machine by laser, and take them up.')
    ] = True,
    tuning: TuningOption = 'robust',
    seed: SeedOption = 1,
    environment: EnvironmentOption = 'nominal',
    arrangement: ArrangementOption = Arrangement.composed,
    out: RunFolderOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Commission a machine: identify, tune, check on the measured response, apply, accept, calibrate, verify, learn,
    report.

    If a step up to acceptance fails, the former gains are restored, the report gives the reason, and the exit code is
    1. Writes report.html, OUT/config with model, gains and calibrated machine (use them with `PKM_CONFIG=OUT/config pkm
    run`), bags, figures, and the search.

    Example: `pkm commission --machine four_dof --specimen 7 --out runs/commissioned`
    """
    discover_on_this_computer()
    from pkm_core.commissioning.config_copy import copy_config
    from pkm_core.commissioning.report import write_page
    from pkm_core.tuning.config import load_tuning

    begun, console, machine, config = monotonic(), Output(), load_machine(machine_name), load_tuning(tuning)
    motion = motion or default_motion(machine)
    to_joints(machine, plan(machine, load_motion(motion)))  # refuses it before anything moves
    plugins = str(law_file(law).resolve().parent)  # refuses it before anything moves
    out = run_folder(out, f'{machine.name}_commissioned')
    options = {'seed': seed, 'environment': environment, 'folder': out}
    place = copy_config(machine, out, environment, truth_seed or None)
    machine = place.machine
    with _bench(arrangement, machine_name, machine, motion, options, plugins) as bench:
        given = {'law': law, 'cycles': cycles, 'limit': 1e-6 * accept, 'seed': seed}
        given['calibrate'] = calibrate and machine.config.mechanism in LINKS  # an xy_stage has no links
        story = _procedure(console, machine, bench, place, config, given, out)
    facts = {
        **{'machine': machine.name, 'specimen': truth_seed, 'motion': Path(motion).stem, 'environment': environment},
        **{'seed': seed, 'arrangement': str(arrangement), 'law': law, 'acceptance limit [um]': accept},
        'duration [s]': round(monotonic() - begun, 1),
    }
    figures = facts | _figures(machine, story)
    do_all(  # a full disk loses one of these, not all
        lambda: _show(console, machine, story, out),
        lambda: write_json(out / 'results.json', figures),
        lambda: write_figures(json_file, figures),
        lambda: write_page(out / 'report.html', machine, story, facts),
    )
    if not story.accepted:
        raise typer.Exit(1)


def _procedure(console, machine, bench, place, config, given, out):
    """Run the steps of the commissioning and return the `Commissioning`; `given` are options of the verb."""
    from pkm_core.commissioning.procedure import commission as run
    from pkm_core.parallel import search_executor

    with search_executor(0, '') as executor, progress_bar(console, name='starting') as bar:

        def on_step(what, share):
            bar.show(share, what)

        return run(machine, bench, place, config, **given, executor=executor, folder=out / 'search', on_step=on_step)


@contextmanager
def _bench(arrangement, machine_name, machine, motion, options, plugins):
    """Yield the bench: the simulated machine, or a cell in the ROS graph."""
    from pkm_core.commissioning.simulated_bench import SimulatedBench

    if arrangement is Arrangement.simulation:
        yield SimulatedBench(machine, machine_name, load_motion(motion), **options)
        return
    from pkm_nodes.clients.commissioning_bench import CellBench

    with CellBench(machine_name, machine, str(motion), arrangement.value, **options, plugins=plugins) as bench:
        yield bench


def _show(console, machine, story, out):
    """Print the tables and the outcome."""
    from pkm_core.commissioning import report

    tables = report.model_table(story), report.candidate_table(story), report.measured_table(story)
    for table in (*tables, report.error_table(machine, story), report.end_point_table(machine, story)):
        if table.rows:
            console.print(report_table(table, align='llr', wide=False))
    console.warnings(story.identified.warnings)
    for text in report.verdict(story):
        console.plain(text)
    console.plain(f'report.html, config, bags and figures are in {out}')


def _figures(machine, story):
    """Return every figure of a `Commissioning` as nested dicts."""

    def errors(move):
        return [dict(zip(machine.joints, (1e6 * a.max_dynamic_error for a in cycle), strict=True)) for cycle in move]

    return {
        'accepted': story.accepted,
        'reasons': story.reasons,
        'not_calibrated': story.not_calibrated,
        'calibration': _calibration(story.calibrated),
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


def _calibration(found):
    """Return the figures of a `Calibrated` [m, phi in rad], or None."""
    if found is None:
        return None
    verification = found.verification
    figures = {
        name: getattr(verification, name) for name in ('before', 'after', 'before_largest', 'after_largest', 'noise')
    }
    return {
        'misfit': found.misfit,
        'taken_up': found.machine_file is not None,
        'end_point': {name: dict(zip(verification.coordinates, row, strict=True)) for name, row in figures.items()},
    }
