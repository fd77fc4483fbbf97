"""
Speed of the simulated machine, its error by step size, and MuJoCo on the same closed chain.

    .venv/bin/uv pip install --require-hashes -r requirements/bench.txt   # MuJoCo; once, not part of the set-up
    .venv/bin/python test/bench/plant.py --json runs/bench_plant.json

All subjects take turns within one run, so other load of the computer affects all of them. Times are processor times.
Ratios are medians over the turns.
"""

import argparse
import json
import os
import platform
import shutil
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from pkm_core.config import Configuration
from pkm_core.experiments.closed_chain import TICKS, MujocoChain, forces, reference, step_rigid
from pkm_core.machines import load_machine
from pkm_core.plant.plant import Plant

PLANTS = (
    ('four_dof', 'nominal'),
    ('four_dof', 'elastic'),
    ('four_dof', 'hard'),
    ('four_dof', 'ideal'),
    ('four_dof', 'geometric'),
    ('four_dof', 'warm'),
    ('four_dof', 'flexible'),
    ('planar', 'nominal'),
    ('planar', 'flexible'),
    ('xy_stage', 'nominal'),
)
TURNS = 9
WHOLE = 'plant four_dof nominal'
ACCURACY = 1e-6  # m, over 70 ms
INTEGRATORS = ('Euler', 'implicitfast', 'RK4')
MUJOCO_SUBSTEPS = (1, 2, 5, 10, 20, 50, 100)
SUBSTEPS = (2.0, 1.0, 0.5, 0.25, 0.125, 0.0625)  # of the configured one; the last is the reference


def moving_plant(name, environment):
    """Return a function that moves a plant back and forth for one simulated second."""
    plant = Plant(load_machine(name), 1, environment)
    ticks = round(1.0 / plant.machine.sample_time)
    sense = np.array([1.0, -1.0, 1.0, 0.8])[: len(plant.machine.joints)]
    volts = np.outer(0.95 * np.cos(89.8 * plant.machine.sample_time * np.arange(ticks)), sense)

    def move():
        plant.reset()
        for row in volts:
            plant.tick(row)
        assert plant.fault is None, plant.fault

    return move


def repeated(function, times):
    """Return a function that calls `function` `times` times, to make a turn long enough for timing."""

    def repeat():
        for _ in range(times):
            function()

    return repeat


def seconds(function):
    """Return the processor time of one call [s]."""
    start = time.process_time()
    function()
    return time.process_time() - start


def take_turns(subjects):
    """Return {name: [x real time of every turn]}; `subjects` holds name: (simulated seconds, function)."""
    for _, function in subjects.values():
        function()  # warm
    speeds = {name: [] for name in subjects}
    for _ in range(TURNS):
        for name, (simulated, function) in subjects.items():
            speeds[name].append(simulated / seconds(function))
    return speeds


def convergence(machine, environment):
    """Return {substep [s]: largest difference [m] of a joint from the finest substep} over 70 ms of case (i)(a)."""
    volts = forces(machine) / machine.thrust_per_volt
    paths = {}
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(machine.configuration.folder, folder, dirs_exist_ok=True)
        copied = machine.with_configuration(Configuration(Path(folder)))
        truth = Path(folder) / 'truth' / f'{machine.name}.yaml'
        text = truth.read_text()
        line = next(line for line in text.splitlines() if line.startswith('substep:'))
        configured = float(line.split()[1])  # us
        for factor in SUBSTEPS:
            truth.write_text(text.replace(line, f'substep: {factor * configured} us'))
            plant, path = Plant(copied, 1, environment), []
            for row in volts:
                plant.tick(row)
                path.append(plant.truth.q)
            paths[1e-6 * factor * configured] = np.array(path)
    *coarser, finest = paths
    return {substep: float(np.abs(paths[substep] - paths[finest]).max()) for substep in coarser}


def mujoco_errors(machine, force, exact):
    """Return {(integrator, substeps): largest error of a joint [m]}, with rising substeps up to ACCURACY."""
    errors = {}
    for integrator in INTEGRATORS:
        for substeps in MUJOCO_SUBSTEPS:
            path = MujocoChain(machine, integrator, substeps).step(force)
            errors[integrator, substeps] = float(np.abs(path - exact).max())
            if errors[integrator, substeps] <= ACCURACY:
                break
    return errors


def rigid_subjects(machine, force, exact, console):
    """Return (subjects of the rigid chain, {name: error [m]}): the plant's rule, and MuJoCo if it is installed."""
    duration = TICKS * machine.sample_time
    subjects, errors = {}, {}
    for substeps in (1, 8):
        name = f"rigid, plant's rule, {1e6 * machine.sample_time / substeps:g} us"
        errors[name] = float(np.abs(step_rigid(machine, force, substeps) - exact).max())
        subjects[name] = (300 * duration, repeated(lambda substeps=substeps: step_rigid(machine, force, substeps), 300))
    try:
        found = mujoco_errors(machine, force, exact)
    except ModuleNotFoundError:
        console.print('MuJoCo is not installed: uv pip install --require-hashes -r requirements/bench.txt')
        return subjects, errors
    for (integrator, substeps), error in found.items():
        if error <= ACCURACY:
            name = f'MuJoCo {integrator}, {1e6 * machine.sample_time / substeps:g} us'
            chain = MujocoChain(machine, integrator, substeps)
            errors[name] = error
            subjects[name] = (3 * duration, repeated(lambda chain=chain: chain.step(force), 3))
    return subjects, errors


def main():
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--json', type=Path, help='also write every figure to this file')
    arguments = parser.parse_args()
    console = Console()
    machine = load_machine('four_dof')
    force = forces(machine)
    exact = reference(machine, force)

    steps = {
        environment: convergence(machine, environment)
        for environment in ('ideal', 'nominal', 'hard', 'elastic', 'flexible')
    }
    table = Table(title='whole plant: largest change of a joint over 70 ms against a 16th of the substep \\[nm]')
    table.add_column('substep \\[us]', justify='right')
    for environment in steps:
        table.add_column(environment, justify='right')
    for substep in steps['ideal']:
        table.add_row(f'{1e6 * substep:g}', *(f'{1e9 * steps[environment][substep]:.3g}' for environment in steps))
    console.print(table)

    subjects = {f'plant {name} {environment}': (1.0, moving_plant(name, environment)) for name, environment in PLANTS}
    rigid, errors = rigid_subjects(machine, force, exact, console)
    speeds = take_turns(subjects | rigid)
    results = {
        name: {
            'times_real_time_median': statistics.median(values),
            'times_real_time_best': max(values),
            'error_70_ms_m': errors.get(name),
        }
        for name, values in speeds.items()
    }
    table = Table(title=f'processor time, {TURNS} turns each')
    for heading in ('', 'x real time, median', 'best', 'error over 70 ms \\[nm]'):
        table.add_column(heading, justify='right' if heading else 'left', no_wrap=not heading)
    for name, row in results.items():
        error = '' if row['error_70_ms_m'] is None else f'{1e9 * row["error_70_ms_m"]:.3g}'
        table.add_row(name, *(f'{row[f"times_real_time_{kind}"]:.1f}' for kind in ('median', 'best')), error)
    console.print(table)

    ratios = {}
    theirs = [name for name in rigid if name.startswith('MuJoCo')]
    if theirs:
        fastest = max(theirs, key=lambda name: results[name]['times_real_time_median'])
        for name in (*(name for name in rigid if name not in theirs), WHOLE):
            turns = (mine / other for mine, other in zip(speeds[name], speeds[fastest], strict=True))
            ratios[f'{name} / {fastest}'] = statistics.median(turns)
        for name, ratio in ratios.items():
            console.print(f'{name}: {ratio:.1f} times as fast')
    if arguments.json:
        figures = {
            'computer': {'processor': platform.processor() or platform.machine(), 'load': os.getloadavg()},
            'convergence_m': {
                name: {f'{1e6 * step:g} us': error for step, error in row.items()} for name, row in steps.items()
            },
            'subjects': results,
            'speed_ratios': ratios,
        }
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps(figures, indent=2) + '\n')


if __name__ == '__main__':
    main()
