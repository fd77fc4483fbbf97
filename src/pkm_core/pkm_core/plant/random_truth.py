"""Random machines: the same controllers and models, another plant."""

from contextlib import contextmanager

import numpy as np
from pydantic import TypeAdapter

from pkm_core.config import Frequency, Number
from pkm_core.plant.changed_truth import change_truth, changed_machine

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
    with changed_machine(machine, environment, _drawing(seed, environment)) as drawn:
        yield drawn


def draw_truth(configuration, name, seed, environment):
    """Overwrite the truth file of the machine `name` in `configuration` with random values, see `random_machine`."""
    change_truth(configuration, name, environment, _drawing(seed, environment))


def _drawing(seed, environment):
    """Return the function that draws the values of a truth file."""

    def change(truth):
        draw = np.random.default_rng(seed)
        for axis in truth['axes'].values():
            axis['gain_error'] = f'{100 * draw.uniform(-GAIN, GAIN)} %'
            for mode in axis['modes']:
                shift = 1 + draw.uniform(-RESONANCE, RESONANCE)
                for key in ('resonance', 'antiresonance'):
                    mode[key] = f'{shift * _HERTZ(mode[key])} Hz'
                    mode[f'{key}_damping'] = _NUMBER(mode[f'{key}_damping']) * float(draw.uniform(*DAMPING))
        truth['environments'][environment]['coulomb_friction'] = f'{draw.uniform(*FRICTION)} N'

    return change
