"""`pkm budget`: how far off the end points of machines will be, and why."""

import time
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pkm_core.machines import load_machine
from pkm_core.verbs.options import JsonOption, MachineOption, OutOption, SeedOption, folder, progress, write_json


def budget(
    machine: MachineOption = 'four_dof',
    tolerances: Annotated[str, typer.Option(help='Tolerances of config/design, or a YAML file.')] = 'tolerances',
    machines: Annotated[int, typer.Option(min=2, help='Machines to build and measure.')] = 10_000,
    poses: Annotated[int, typer.Option(min=1, help='Poses over the workspace, the same for all.')] = 64,
    seed: SeedOption = 1,
    scheduler: Annotated[
        str | None, typer.Option(help='Address of a dask cluster, e.g. tcp://host:8786; here without it.')
    ] = None,
    out: OutOption = None,
    json_file: JsonOption = None,
):
    """
    Tell the end-point error that tolerances, encoders, belts and warmth will cause, linear and by Monte Carlo.

    Contributions are ranked. The same seed gives the same bits, also on a cluster.

    Example: `pkm budget --machines 10000 --out runs/budget`

    Example: `pkm budget --tolerances my_tolerances.yaml --machines 1000000 --scheduler tcp://host:8786`
    """
    import numpy as np

    from pkm_core.design.budget import linear_budget
    from pkm_core.design.budget_figures import draw_contributions, draw_distribution, draw_map
    from pkm_core.design.budget_monte_carlo import MACHINES_A_BLOCK, monte_carlo_budget, study_poses
    from pkm_core.design.tolerances import load_tolerances
    from pkm_core.design.units import units

    console, model, out = Console(), load_machine(machine).drawing, folder(out)
    spreads = load_tolerances(tolerances)
    with progress(console, -(-machines // MACHINES_A_BLOCK) + 2) as step:
        step('first order')
        q = study_poses(model, poses, seed)
        linear = linear_budget(model, spreads, q)
        start = time.perf_counter()
        found = monte_carlo_budget(
            model, spreads, q, machines, seed, scheduler, lambda: step('building and measuring machines')
        )
        seconds = time.perf_counter() - start
        if out:
            step('figures')
            draw_distribution(out, model, linear, found)
            draw_contributions(out, model, linear)
            draw_map(out, model, spreads, seed)
    scale = np.array([factor for factor, _ in units(model)])
    rows = {
        'linear, deviation': scale * np.sqrt(np.mean(linear.total() ** 2, axis=0)),
        'linear, at the worst pose': scale * linear.total().max(axis=0),
        'simulated, deviation': scale * np.sqrt(np.mean(found.deviation**2, axis=0)),
        'simulated, at the worst pose': scale * found.deviation.max(axis=0),
        'half of all stay within': scale * found.quantile(0.5),
        '95 % stay within': scale * found.quantile(0.95),
        '99.7 % stay within': scale * found.quantile(0.997),
    }
    names = [f'{name}_{unit}' for name, (_, unit) in zip(model.coordinates, units(model), strict=True)]
    write_json(
        json_file,
        {
            'machine': model.name,
            'tolerances': tolerances,
            'machines': machines,
            'poses': poses,
            'seed': seed,
            'seconds': seconds,
            'error': {title: dict(zip(names, row, strict=True)) for title, row in rows.items()},
            'shares_of_variance': {
                group: dict(zip(model.coordinates, row, strict=True)) for group, row in linear.shares().items()
            },
            'sources': {
                name: dict(zip(names, scale * row, strict=True)) for name, row in linear.source_deviations().items()
            },
        },
    )
    headings = [f'{name} \\[{unit}]' for name, (_, unit) in zip(model.coordinates, units(model), strict=True)]
    console.print(_table(f'{model.name}: end-point error, {machines} machines at {poses} poses', headings, rows))
    shares = {group: 100.0 * row for group, row in linear.shares().items()}
    console.print(_table('share of the variance, linear', [f'{name} \\[%]' for name in model.coordinates], shares))
    sources = {name: scale * row for name, row in linear.source_deviations().items()}
    console.print(_table('what each source gives alone, linear deviation', headings, sources))
    console.print(f'{machines} machines simulated in {seconds:.2f} s')
    if out:
        console.print(f'figures are in {out}', soft_wrap=True)


def _table(title, headings, rows):
    table = Table(title=title, title_justify='left')
    table.add_column('')
    for heading in headings:
        table.add_column(heading, justify='right')
    for name, row in rows.items():
        table.add_row(name, *(f'{value:.2f}' for value in row))
    return table
