"""`pkm budget`: end-point error of machines built within tolerances, and the share of each source in it."""

import time
from typing import Annotated, NamedTuple

import typer

from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, progress_bar, table
from pkm_core.verbs.options import (
    ClusterOption,
    EnvironmentOption,
    JsonOption,
    MachineOption,
    OutOption,
    OverwriteOption,
    ProcessesOption,
    SeedOption,
    TolerancesOption,
    out_folder,
    write_figures,
)


class _Result(NamedTuple):
    """Both budgets of a machine, and the wall time [s] of the Monte-Carlo one."""

    linear: object  # `LinearBudget`
    simulated: object  # `Distribution`
    seconds: float


def budget(
    machine_name: MachineOption = 'four_dof',
    tolerances: TolerancesOption = 'tolerances',
    machines: Annotated[int, typer.Option(min=2, help='Number of machines to build and measure.')] = 10_000,
    poses: Annotated[int, typer.Option(min=1, help='Number of poses over the workspace, the same for all.')] = 64,
    geometry: Annotated[bool, typer.Option('--guides', help='Include guides and scales among the sources.')] = False,
    measured: Annotated[
        int,
        typer.Option(min=0, help='Simulated machines that are measured, calibrated and measured again; 0: none.'),
    ] = 0,
    environment: EnvironmentOption = 'nominal',
    seed: SeedOption = 1,
    processes: ProcessesOption = 0,
    cluster: ClusterOption = '',
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Compute the end-point error caused by tolerances, encoders, belts and temperature, linearly and by Monte Carlo.

    Sources are ranked by their share of the variance. The same seed gives the same bits with and without a cluster.
    --measured puts predictions beside simulated machines of --environment with the seeds 1 to N: sent by the drawing,
    calibrated with 20 poses by encoders and laser, sent again, and judged by the truth at 50 other poses.

    Example: `pkm budget --machines 10000 --out runs/budget`

    Example: `pkm budget --measured 20 --environment geometric --guides`

    Example: `pkm budget --tolerances my_tolerances.yaml --machines 1000000 --cluster tcp://host:8786`
    """
    from pkm_core.design.tolerances import load_tolerances

    console, machine, out = Output(), load_machine(machine_name).drawing, out_folder(out)
    spreads = load_tolerances(tolerances)
    result = _compute(console, machine, spreads, geometry, machines, poses, seed, cluster, out)
    figures = {'machine': machine.name, 'tolerances': tolerances, 'machines': machines, 'poses': poses, 'seed': seed}
    figures |= _figures(machine, result)
    _print(console, machine, result, machines, poses)
    if spreads.joint_clearance is not None:
        play = _play(machine, spreads.joint_clearance, poses, seed)
        figures['joint_clearance'] = _named(machine, play)
        console.print(_table('play of the joints at both ends of all links', _headings(machine), play))
    if measured:
        rows = _measure(console, machine_name, machine, spreads, environment, measured, (processes, cluster))
        figures['measured'] = {'environment': environment, 'specimens': measured, 'error': _named(machine, rows)}
        title = f'{machine.name} {environment}: predictions, and {measured} machines, root mean square at 50 poses'
        console.print(_table(title, _headings(machine), rows, '.3f'))
    write_figures(json_file, figures)
    if out:
        console.plain(f'figures are in {out}')


def _measure(console, machine_name, machine, spreads, environment, specimens, workers):
    """Return {what: error (m,)} in the units that are printed, of predictions and of simulated machines."""
    from pkm_core.experiments.measured_budget import measured_rows, measured_tasks
    from pkm_core.experiments.runs import farm
    from pkm_core.parallel import search_executor

    tasks = measured_tasks(machine_name, spreads, environment, specimens)
    with progress_bar(console, specimens, name='machines') as bar, search_executor(*workers) as executor:
        results = farm(executor, tasks, lambda done: bar.show(done, 'measuring and calibrating'))
    rows = measured_rows(machine_name, spreads, environment, results)
    return {title: row * _scale(machine) for title, row in rows.items()}


def _compute(console, machine, spreads, geometry, machines, poses, seed, cluster, out):
    """Return the `_Result`; figures are drawn into `out` if it is not None."""
    from pkm_core.design.budget import linear_budget
    from pkm_core.design.budget_figures import draw_contributions, draw_distribution, draw_map
    from pkm_core.design.budget_monte_carlo import MACHINES_A_BLOCK, monte_carlo_budget, study_poses

    with progress_bar(console, -(-machines // MACHINES_A_BLOCK) + 2) as bar:
        bar.step('first order')
        q = study_poses(machine, poses, seed)
        linear = linear_budget(machine, spreads, q, geometry)
        start = time.perf_counter()
        simulated = monte_carlo_budget(
            machine,
            spreads,
            q,
            machines,
            seed,
            cluster or None,
            lambda: bar.step('building and measuring machines'),
            geometry,
        )
        seconds = time.perf_counter() - start
        if out:
            bar.step('figures')
            draw_distribution(out, machine, linear, simulated)
            draw_contributions(out, machine, linear)
            draw_map(out, machine, spreads, seed, geometry)
    return _Result(linear, simulated, seconds)


def _play(machine, clearance, poses, seed):
    """Return {what: end-point error (m,)} in the units that are printed, of single- and of multi-DOF joints."""
    from pkm_core.design.budget import clearance_deviations
    from pkm_core.design.budget_monte_carlo import study_poses

    rows, q = {}, study_poses(machine, poses, seed)
    for title, play in (('single-DOF', clearance.single_dof), ('multi-DOF', clearance.multi_dof)):
        deviation, worst = clearance_deviations(machine, play, q)
        rows[f'{title}, {1e6 * play:g} um: deviation'] = _scale(machine) * deviation
        rows[f'{title}, {1e6 * play:g} um: worst case'] = _scale(machine) * worst
    return rows


def _scale(machine):
    """Return the factors (m,) from SI to the units that are printed."""
    import numpy as np

    from pkm_core.design.units import units

    return np.array([factor for factor, _ in units(machine)])


def _errors(machine, result):
    """Return {what: error (m,)} in the units that are printed."""
    import numpy as np

    scale, linear, simulated = _scale(machine), result.linear, result.simulated
    return {
        'linear, deviation': scale * np.sqrt(np.mean(linear.total() ** 2, axis=0)),
        'linear, at the worst pose': scale * linear.total().max(axis=0),
        'simulated, deviation': scale * np.sqrt(np.mean(simulated.deviation**2, axis=0)),
        'simulated, at the worst pose': scale * simulated.deviation.max(axis=0),
        'half of all stay within': scale * simulated.quantile(0.5),
        '95 % stay within': scale * simulated.quantile(0.95),
        '99.7 % stay within': scale * simulated.quantile(0.997),
    }


def _figures(machine, result):
    scale = _scale(machine)
    return {
        'seconds': result.seconds,
        'error': _named(machine, _errors(machine, result)),
        'shares_of_variance': {
            group: dict(zip(machine.coordinates, row, strict=True)) for group, row in result.linear.shares().items()
        },
        'sources': _named(machine, {name: scale * row for name, row in result.linear.source_deviations().items()}),
    }


def _named(machine, rows):
    """Return {what: {coordinate and unit: number}} of {what: row (m,)}."""
    from pkm_core.design.units import units

    names = [f'{name}_{unit}' for name, (_, unit) in zip(machine.coordinates, units(machine), strict=True)]
    return {title: dict(zip(names, row, strict=True)) for title, row in rows.items()}


def _headings(machine):
    from pkm_core.design.units import units

    return [f'{name} [{unit}]' for name, (_, unit) in zip(machine.coordinates, units(machine), strict=True)]


def _print(console, machine, result, machines, poses):
    headings = _headings(machine)
    title = f'{machine.name}: end-point error, {machines} machines at {poses} poses'
    console.print(_table(title, headings, _errors(machine, result)))
    shares = {group: 100.0 * row for group, row in result.linear.shares().items()}
    console.print(_table('share of the variance, linear', [f'{name} [%]' for name in machine.coordinates], shares))
    sources = {name: _scale(machine) * row for name, row in result.linear.source_deviations().items()}
    console.print(_table('what each source gives alone, linear deviation', headings, sources))
    console.print(f'{machines} machines simulated in {result.seconds:.2f} s')


def _table(title, headings, rows, form='.2f'):
    return table(title, ['', *headings], [(name, *(f'{value:{form}}' for value in row)) for name, row in rows.items()])
