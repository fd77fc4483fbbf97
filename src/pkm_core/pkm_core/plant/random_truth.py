"""
Random machines: the same controllers and models, another plant.

The drawn values are written into a copy of config/truth; models, gains and laws do not change.
"""

import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import yaml
from pydantic import TypeAdapter

from pkm_core.config import Configuration, Frequency, Number, load_config, read_yaml
from pkm_core.errors import ConfigError
from pkm_core.plant.truth import Truth

GAIN = 0.2  # half width of the uniform spread of the thrust of each axis
RESONANCE = 0.05  # half width for every mode; one factor for resonance and anti-resonance
DAMPING = (0.6, 1.5)  # factor on every damping
FRICTION = (0.1, 1.0)  # [N] Coulomb friction, the same for all guides

_HERTZ, _NUMBER = (TypeAdapter(kind).validate_python for kind in (Frequency, Number))


@contextmanager
def random_machine(machine, seed, environment='nominal'):
    """
    Yield `machine` with a configuration whose plant is random; the configuration is deleted when the block ends.

    The same `seed` (an int or a tuple of ints) gives the same plant. Thrust, modes, dampings and, in `environment`,
    Coulomb friction are drawn.

    Raises
    ------
    ConfigError
        If the truth file has no such environment.

    """
    with tempfile.TemporaryDirectory() as folder:
        copied = Configuration(Path(folder) / 'config')
        shutil.copytree(machine.configuration.folder, copied.folder)
        draw_truth(copied, machine.name, seed, environment)
        yield machine.with_configuration(copied)


def draw_truth(configuration, name, seed, environment):
    """Overwrite the truth file of the machine `name` in `configuration` with random values, see `random_machine`."""
    draw = np.random.default_rng(seed)
    path = configuration.find('truth', name)
    load_config(path, Truth)  # refuses a file that is none
    truth = read_yaml(path)
    if environment not in truth['environments']:
        raise ConfigError(f'{path}: environment {environment!r} is unknown; known: {sorted(truth["environments"])}')
    for axis in truth['axes'].values():
        axis['gain_error'] = f'{100 * draw.uniform(-GAIN, GAIN)} %'
        for mode in axis['modes']:
            shift = 1 + draw.uniform(-RESONANCE, RESONANCE)
            for key in ('resonance', 'antiresonance'):
                mode[key] = f'{shift * _HERTZ(mode[key])} Hz'
                mode[f'{key}_damping'] = _NUMBER(mode[f'{key}_damping']) * float(draw.uniform(*DAMPING))
    truth['environments'][environment]['coulomb_friction'] = f'{draw.uniform(*FRICTION)} N'
    path.write_text(yaml.safe_dump(truth, sort_keys=False), encoding='utf-8')
