"""Random machines: the same controllers and models, another plant."""

from contextlib import contextmanager

import numpy as np
from pydantic import TypeAdapter

from pkm_core.config import Force, Frequency, Number
from pkm_core.plant.changed_truth import change_truth, changed_machine

GAIN = 0.2  # half width of the uniform spread of the thrust of each axis
RESONANCE = 0.05  # half width for every mode; one factor for resonance and anti-resonance
DAMPING = (0.6, 1.5)  # factor on every damping
FRICTION = (0.1, 1.0)  # [N] Coulomb friction, the same for all guides
# chosen: twice the spread of the modes, friction relative to its environment, and viscosity
WIDE_GAIN, WIDE_RESONANCE, WIDE_DAMPING, WIDE_FRICTION, WIDE_VISCOSITY = 0.1, 0.1, (0.5, 1.5), (0.5, 3.0), 0.4

_HERTZ, _NUMBER, _NEWTON = (TypeAdapter(kind).validate_python for kind in (Frequency, Number, Force))


@contextmanager
def random_machine(machine, seed, environment='nominal', *, wide=False):
    """
    Yield `machine` with a configuration whose plant is random; the configuration is deleted when the block ends.

    The same `seed` (an int or a tuple of ints) gives the same plant. Thrust, modes, dampings and, in `environment`,
    Coulomb friction are drawn; `wide` draws modes, friction and viscosity from a wider range.

    Raises
    ------
    ConfigError
        If the truth file has no such environment.

    """
    with changed_machine(machine, environment, _drawing(seed, environment, wide)) as drawn:
        yield drawn


def draw_truth(configuration, name, seed, environment, *, wide=False):
    """Overwrite the truth file of the machine `name` in `configuration` with random values, see `random_machine`."""
    change_truth(configuration, name, environment, _drawing(seed, environment, wide))


def _drawing(seed, environment, wide):
    """Return the function that draws the values of a truth file."""

    def change(truth):
        draw = np.random.default_rng(seed)
        gain, resonance, damping = (WIDE_GAIN, WIDE_RESONANCE, WIDE_DAMPING) if wide else (GAIN, RESONANCE, DAMPING)
        for axis in truth['axes'].values():
            axis['gain_error'] = f'{100 * draw.uniform(-gain, gain)} %'
            if wide:
                axis['viscosity_error'] = f'{100 * draw.uniform(-WIDE_VISCOSITY, WIDE_VISCOSITY)} %'
            for mode in axis['modes']:
                shift = 1 + draw.uniform(-resonance, resonance)
                for key in ('resonance', 'antiresonance'):
                    mode[key] = f'{shift * _HERTZ(mode[key])} Hz'
                    mode[f'{key}_damping'] = _NUMBER(mode[f'{key}_damping']) * float(draw.uniform(*damping))
        level = truth['environments'][environment]
        factor = _NEWTON(level['coulomb_friction']) if wide else 1.0
        level['coulomb_friction'] = f'{factor * draw.uniform(*(WIDE_FRICTION if wide else FRICTION))} N'

    return change
