"""
Learning between cycles: the error of one cycle in, the feedforward of the next one out.

A law has ``update(joint, error, feedforward, iteration, sample_time) -> feedforward`` and keeps no state. The
feedforward [V] adds to the output of the PID, before lag and notch; error is r - y [m]. Both are (N,), one periodic
cycle whose boundary lies in a rest. `iteration` counts the updates this feedforward has had.

Some laws must know what is driven. ``law.with_reference(trajectory)``, a `SampledTrajectory` in joints, returns the
law for that motion, to be used like any other; laws that need no reference return themselves. So a caller that has the
trajectory always writes ``law = law.with_reference(trajectory)``, and one that has not is refused by such a law only.

No law starts before its convergence test (convergence.py): `make_law` refuses one that would diverge on the model of
an axis or on a perturbed one; what the test found is the law's `verdict`. What happens on the machine is watched by a
`Monitor` (monitor.py) a joint, and what has been learned is kept by store.py.
"""

from pkm_core.config import find_config, load_config
from pkm_core.errors import LearningError
from pkm_core.learning.basis import BasisConfig, BasisLaw
from pkm_core.learning.convergence import checked
from pkm_core.learning.fourier import FourierConfig, FourierLaw
from pkm_core.learning.inverse import InverseConfig, InverseLaw
from pkm_core.learning.norm_optimal import NormOptimalConfig, NormOptimalLaw

LAWS = {  # name: (model of config/learning/<name>.yaml, law)
    'fourier': (FourierConfig, FourierLaw),
    'fourier_pid': (FourierConfig, FourierLaw),
    'inverse': (InverseConfig, InverseLaw),
    'norm_optimal': (NormOptimalConfig, NormOptimalLaw),
    'basis': (BasisConfig, BasisLaw),
}


def make_law(name, machine, control):
    """
    Return the learning law `name` for `machine` under the gains `control` of `load_control`.

    Raises
    ------
    LearningError
        If there is no such law, or it would diverge; the factor, where, and on which model are named.

    """
    return checked(name, untested_law(name, machine, control))


def untested_law(name, machine, control):
    """Return the law as `make_law` does, without its convergence test: to look at that test's figures."""
    if name not in LAWS:
        raise LearningError(f'learning law {name!r} is unknown; known: {sorted(LAWS)}')
    config, law = LAWS[name]
    return law(load_config(find_config('learning', name), config), machine, control)
