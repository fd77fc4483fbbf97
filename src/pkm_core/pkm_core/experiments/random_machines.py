"""
How a law does on machines it was not designed for: the same controllers and models, and randomly other plants.

What is drawn is written into a copy of the plant's own file, config/truth; models, gains and laws stay as they are.
"""

import os
import shutil
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from pydantic import TypeAdapter

from pkm_core.config import Frequency, Number, config_folder, read_yaml
from pkm_core.errors import ConfigError
from pkm_core.simulation.cycles import run_cycles

GAIN = 0.2  # half width of the uniform spread of every axis's thrust
RESONANCE = 0.05  # of every mode, resonance and anti-resonance alike
DAMPING = (0.6, 1.5)  # factor on every damping
FRICTION = (0.1, 1.0)  # [N] of all guides

_HERTZ, _NUMBER = (TypeAdapter(kind).validate_python for kind in (Frequency, Number))


@dataclass(frozen=True)
class Study:
    """What became of each machine."""

    error: np.ndarray  # (machines, cycles) [m] max dynamic error, worst axis
    settling_time_5um: np.ndarray  # (machines, cycles) [s] worst axis
    notices: tuple[str, ...]  # of the monitors, with the number of the machine

    def converged(self, cycles=10):
        """Return each machine's mean error (machines,) [m] over its last `cycles`."""
        return self.error[:, -cycles:].mean(axis=1)


def study(machine, trajectory, control, law, *, machines=50, cycles=20, seed=1, environment='nominal'):
    """
    Return the `Study` of `law` on `machines` random machines; other arguments as for `run_cycles`.

    Machine k of a seed is the same for every law.
    """
    error, settling, notices = np.zeros((machines, cycles)), np.zeros((machines, cycles)), []
    for number in range(machines):
        records = drive_one(machine, trajectory, control, law, number, cycles, seed, environment)
        error[number] = records.metric('max_dynamic_error').max(axis=1)
        settling[number] = records.metric('settling_time_5um').max(axis=1)
        notices += [f'machine {number}: {notice}' for notice in records.notices]
    return Study(error, settling, tuple(notices))


def drive_one(machine, trajectory, control, law, number, cycles, seed=1, environment='nominal'):
    """Return the `CycleRecords` of the random machine `number` of a `seed`; other arguments as for `run_cycles`."""
    with random_machine(machine, (seed, number), environment):
        return run_cycles(machine, trajectory, control, law, cycles, seed + number, environment)


@contextmanager
def random_machine(machine, seed, environment='nominal'):
    """Make every plant of `machine` that is built within a random one; the same `seed` gives the same."""
    draw = np.random.default_rng(seed)
    original = config_folder()
    path = original / 'truth' / f'{machine.name}.yaml'
    truth = read_yaml(path)
    if environment not in truth['environments']:
        raise ConfigError(f'{path}: environment {environment!r} is unknown; known: {sorted(truth["environments"])}')
    for axis in truth['axes'].values():
        axis['gain_error'] = f'{100 * draw.uniform(-GAIN, GAIN)} %'
        for mode in axis['modes']:
            shift = 1 + draw.uniform(-RESONANCE, RESONANCE)
            for name in ('resonance', 'antiresonance'):
                mode[name] = f'{shift * _HERTZ(mode[name])} Hz'
                mode[f'{name}_damping'] = _NUMBER(mode[f'{name}_damping']) * float(draw.uniform(*DAMPING))
    truth['environments'][environment]['friction'] = f'{draw.uniform(*FRICTION)} N'
    before = os.environ.get('PKM_CONFIG')
    with tempfile.TemporaryDirectory() as folder:
        copied = Path(shutil.copytree(original, Path(folder) / 'config'))
        (copied / 'truth' / f'{machine.name}.yaml').write_text(yaml.safe_dump(truth, sort_keys=False), encoding='utf-8')
        os.environ['PKM_CONFIG'] = str(copied)
        try:
            yield
        finally:
            if before is None:
                del os.environ['PKM_CONFIG']
            else:
                os.environ['PKM_CONFIG'] = before
