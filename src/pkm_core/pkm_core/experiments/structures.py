"""
PID beside observer: the error by cycle of the same machines under both laws, with the same learning law.

`shipped` runs on the models of config/model. `identified` runs on models identified by `pkm identify`'s experiments
under the shipped PID, friction included, with gains and weights as shipped; `wide` the same on random machines
(`random_machine`, wide).
"""

import shutil
import tempfile
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.config import Configuration
from pkm_core.control.controllers import choose_control
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.experiments.condition import motion_of
from pkm_core.experiments.identified import identified_models
from pkm_core.experiments.outcome import spread
from pkm_core.identification.model_file import write_model
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.random_truth import random_machine
from pkm_core.reporting.tables import Table
from pkm_core.simulation.cycles import run_cycles

LAWS = {'PID': 'robust', 'observer': 'observer'}
MACHINES = {'four_dof': '4-DOF', 'planar': 'planar'}
ENVIRONMENTS = {'four_dof': ('nominal', 'hard', 'elastic'), 'planar': ('nominal', 'hard')}
CASES = ('shipped', 'identified', 'wide')
CYCLES = 40
WIDE_PER_SEED = 2
LAW = 'inverse'
BEYOND = 50e-6  # [m] in a cycle from 4 on counts as diverged: the first cycle without learning has less
_RANGES = {'4-13': slice(3, 13), '21-40': slice(20, 40)}


@dataclass(frozen=True)
class Run:
    """One machine with one seed: by law, the error [m] of the worst axis by cycle, or the refusal."""

    error: dict[str, np.ndarray]  # (CYCLES,)
    refused: dict[str, str]


def structure_tasks(seeds):
    """Return {key: tuple of a function and its arguments} of all runs, for `farm`."""
    tasks = {}
    for machine in MACHINES:
        for environment in ENVIRONMENTS[machine]:
            for case in CASES:
                for number in range(seeds * (WIDE_PER_SEED if case == 'wide' else 1)):
                    tasks[machine, environment, case, number] = (compare, machine, environment, case, number)
    return tasks


def compare(name, environment, case, number):
    """Return the `Run` of the machine `name` with seed `number` + 1, of one of `CASES`."""
    machine, seed = load_machine(name), number + 1
    drawn = random_machine(machine, (seed, 77), environment, wide=True) if case == 'wide' else nullcontext(machine)
    with drawn as built:
        if case == 'shipped':
            return _run(built, environment, seed)
        try:
            models = identified_models(built, load_control(built), seed, environment)
        except PkmError as error:
            return Run({}, dict.fromkeys(LAWS, f'not identified: {error}'))
        with with_models(built, models) as known:
            return _run(known, environment, seed)


@contextmanager
def with_models(machine, models):
    """Yield `machine` with a configuration that has `models` {joint: AxisModel}; deleted when the block ends."""
    with tempfile.TemporaryDirectory() as folder:
        copied = Configuration(Path(folder) / 'config')
        shutil.copytree(machine.configuration.folder, copied.folder)
        write_model(copied.folder / 'model' / f'{machine.name}.yaml', machine, {}, models, 'an experiment')
        yield machine.with_configuration(copied)


def _run(machine, environment, seed):
    error, refused = {}, {}
    joints = to_joints(machine, plan(machine, motion_of(machine)[1]))
    for law, control in LAWS.items():
        try:
            gains = choose_control(machine, control)
            records = run_cycles(machine, joints, gains, make_law(LAW, machine, gains), CYCLES, seed, environment)
        except PkmError as reason:
            refused[law] = str(reason)
            continue
        error[law] = records.metric('max_dynamic_error').max(axis=1)
    return Run(error, refused)


def structures_report(results, seeds):
    """Return ([`Table`], figures) for {key: `Run`} of `structure_tasks`."""
    rows, data = [], []
    for machine, name in MACHINES.items():
        for environment in ENVIRONMENTS[machine]:
            for case in CASES:
                runs = [run for key, run in results.items() if key[:3] == (machine, environment, case)]
                for law in LAWS:
                    cells, figures = _row(runs, law)
                    rows.append([name, environment, case, law, *cells])
                    data.append({'machine': machine, 'environment': environment, 'case': case, 'law': law, **figures})
    title = (
        f'PID and observer, learning law {LAW}: largest error of the worst axis by the encoders, mean (95 %) um of '
        f'{seeds} seeds; wide: {WIDE_PER_SEED * seeds} machines'
    )
    headings = ['', '', 'models', 'law', 'cycle 1', '2', '3', *_RANGES, 'beyond', 'refused']
    return [Table(title, headings, rows)], {'experiment': 'structures', 'seeds': seeds, 'rows': data}


def _row(runs, law):
    """Return the cells and the figures of one law over `runs`."""
    refused = [run.refused[law] for run in runs if law in run.refused]
    done = [run for run in runs if law in run.error]
    if not done:
        return ['-'] * (len(_RANGES) + 4) + [str(len(refused))], {'refused': refused}
    error = 1e6 * np.array([run.error[law] for run in done])
    beyond = int((error[:, 3:].max(axis=1) > 1e6 * BEYOND).sum())
    ranges = {'cycle 1': slice(0, 1), '2': slice(1, 2), '3': slice(2, 3), **_RANGES}
    found = {title: spread(error[:, cycles]) for title, cycles in ranges.items()}
    cells = [f'{each.mean:.2f} ({each.p95:.2f})' for each in found.values()]
    figures: dict = {title: (each.mean, each.p95) for title, each in found.items()}
    figures |= {'beyond': beyond, 'refused': refused, 'worst_machine': float(error[:, 3:].max())}
    return [*cells, str(beyond), str(len(refused))], figures
