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

from pkm_core.config import Configuration, find_config, parse_config, read_yaml
from pkm_core.errors import ConfigError, LearningError
from pkm_core.learning.basis import BasisLaw
from pkm_core.learning.convergence import checked
from pkm_core.learning.fourier import FourierLaw
from pkm_core.learning.inverse import InverseLaw
from pkm_core.learning.law import Law
from pkm_core.learning.norm_optimal import NormOptimalLaw
from pkm_core.learning.store import design_hash
from pkm_core.plugins import load_class

KINDS = {'fourier': FourierLaw, 'inverse': InverseLaw, 'norm_optimal': NormOptimalLaw, 'basis': BasisLaw}


# laws that have passed their test, by all that it depends on: laws keep nothing, and a cell asks for one in two places
_passed = {}


def law_names(configuration=None):
    """Return the names of the laws in config/learning, by default of the environment's configuration."""
    return (configuration or Configuration.of_environment()).names('learning')


def law_file(name, configuration=None):
    """Return the file of the law `name`, in config/learning or a YAML file; `LearningError` if there is none."""
    try:
        return find_config('learning', name, configuration)
    except ConfigError:
        known = ['none', *law_names(configuration)]
        raise LearningError(f'learning law {name!r} is unknown; known: {known}, or a YAML file') from None


def make_law(name, machine, control):
    """
    Return the learning law `name` for `machine` under the gains `control` of `load_control`.

    Its file names the kind under the key ``law``: one of `KINDS`, or ``my_law.py:MyLaw``, a `Law` in a Python file
    beside it. The other keys are the parameters, checked by the class's ``Parameters``.

    Raises
    ------
    LearningError
        If there is no such law, or it would diverge; the factor, where, and on which model are named.
    ConfigError
        If its file is refused.

    """
    law = untested_law(name, machine, control)
    key = name, type(law), law.config.model_dump_json(), design_hash(machine, control)
    if key not in _passed:
        _passed[key] = checked(name, law)
    return _passed[key]


def untested_law(name, machine, control):
    """Return the law as `make_law` does, without its convergence test: to look at that test's figures."""
    path = law_file(name, machine.configuration)
    parameters = read_yaml(path)
    kind = parameters.pop('law', None)
    law = KINDS.get(kind) if isinstance(kind, str) else None
    if law is None:
        law = load_class(kind, base=Law, beside=path, key='law', known=KINDS)
    return law(parse_config(parameters, law.Parameters, where=str(path)), machine, control)
