"""
Learning between cycles: the error of one cycle in, the feedforward of the next one out.

A law has ``update(joint, error, feedforward, iteration, sample_time) -> feedforward`` and keeps no state. The
feedforward [V] adds to the output of the PID, before lag and notch; error is r - y [m]. Both are (N,), one periodic
cycle whose boundary lies in a rest. `iteration` counts the updates this feedforward has had.
"""

from pkm_core.config import find_config, load_config
from pkm_core.errors import LearningError
from pkm_core.learning.fourier import FourierConfig, FourierLaw

LAWS = {  # name: (model of config/learning/<name>.yaml, law)
    'fourier': (FourierConfig, FourierLaw),
    'fourier_pid': (FourierConfig, FourierLaw),
}


def make_law(name, machine, control):
    """
    Return the learning law `name` for `machine` under the gains `control` of `load_control`.

    Raises
    ------
    LearningError
        If there is no such law.

    """
    if name not in LAWS:
        raise LearningError(f'learning law {name!r} is unknown; known: {sorted(LAWS)}')
    config, law = LAWS[name]
    return law(load_config(find_config('learning', name), config), control, machine.sample_time)
