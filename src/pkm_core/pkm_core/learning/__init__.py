"""
Learning between cycles: from the error of one cycle to the feedforward of the next one.

A law has ``update(joint, error, feedforward, iteration, sample_time) -> feedforward`` and no state. The feedforward [V]
is added to the output of the PID, before lag and notch; error is r - y [m]. Both are (N,), one periodic cycle whose
boundary is in a rest. `iteration` is the number of updates this feedforward has had.

Some laws need the reference. ``law.with_reference(trajectory)``, a `SampledTrajectory` in joints, returns the law for
that motion; a law that needs no reference returns itself. A caller with a trajectory always calls
``law = law.with_reference(trajectory)``. Without a trajectory only a law that needs one is refused.

Every law passes a convergence test before it is used (convergence.py): `make_law` refuses one that diverges on the
model of an axis or on a perturbed model; the result is the law's `verdict`. On the machine one `Monitor` per joint
(monitor.py) detects divergence. store.py saves the learned feedforward.
"""

from pkm_core.config import Configuration, find_config, parse_config, read_yaml
from pkm_core.config_errors import short
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


# laws that have passed their test, by everything it depends on: laws have no state, and a cell makes each one twice
_passed = {}


def law_names(configuration=None):
    """Return the names of the laws in config/learning; default configuration: of the environment."""
    return (configuration or Configuration.of_environment()).names('learning')


def law_file(name, configuration=None):
    """Return the file of the law `name`, of config/learning or a YAML file; `LearningError` if there is none."""
    try:
        return find_config('learning', name, configuration)
    except ConfigError:
        known = ['none', *law_names(configuration)]
        raise LearningError(f'learning law {short(str(name))} is unknown; known: {known}, or a YAML file') from None


def make_law(name, machine, gains):
    """
    Return the learning law `name` for `machine` under the gains `gains` of `load_control`.

    The key ``law`` of its file is the kind: one of `KINDS`, or ``my_law.py:MyLaw``, a `Law` in a Python file of the
    same folder. The other keys are the parameters, checked by the class's ``Parameters``.

    Raises
    ------
    LearningError
        If there is no such law, or it diverges; the message has factor, frequency and model.
    ConfigError
        If its file is refused.

    """
    law = untested_law(name, machine, gains)
    key = name, type(law), law.config.model_dump_json(), design_hash(machine, gains)
    if key not in _passed:
        _passed[key] = checked(name, law)
    return _passed[key]


def untested_law(name, machine, gains):
    """Return the law as `make_law` does, without the convergence test, for example to report the test's figures."""
    path = law_file(name, machine.configuration)
    parameters = read_yaml(path)
    kind = parameters.pop('law', None)
    law = KINDS.get(kind) if isinstance(kind, str) else None
    if law is None:
        law = load_class(kind, base=Law, beside=path, key='law', known=KINDS, folders=machine.configuration.plugins)
    return law(parse_config(parameters, law.Parameters, where=str(path)), machine, gains)
