"""Gains of the controller of an axis as messages, and as parameters of a node that may change while it runs."""

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from pkm_core.config import parse_config
from pkm_core.control.observer_design import ObserverLaw, ObserverWeights
from pkm_core.control.robust import RobustGains
from pkm_core.errors import PkmError
from pkm_interfaces.msg import RobustGains as RobustGainsMessage

GAINS = {  # description by parameter
    'kp': '[V/m] proportional gain',
    'ki': '[V/(m s)] integral gain',
    'kd': '[V s/m] derivative gain',
    'derivative_filter': '[s] time constant of the derivative',
    'lag.pole': '[Hz] pole of the lag filter',
    'lag.zero': '[Hz] zero of the lag filter',
    'lag.dc_gain': '[1] gain of the lag filter at rest',
    'notch.centre': '[Hz] centre of the notch',
    'notch.width': '[Hz] width of the notch',
    'notch.attenuation': '[dB] attenuation at the centre of the notch',
}
WEIGHTS = {  # of an observer law
    'effort': '[m/V] error that counts as much as 1 V of feedback',
    'speed': '[s] weight of the speed of the error',
    'force_noise': '[V] deviation of the force in one sample',
    'drift': '[V] deviation of the step of the disturbance in one sample',
    'encoder_noise': '[m] deviation of the reading',
    'mode_noise': '[m] deviation of the states of the modes in one sample',
    'mode_damping': '[1] factor of the dampings in the design',
}


def flat(gains):
    """Return {name of `GAINS`: value} of `RobustGains`, {name of `WEIGHTS`: value} of an `ObserverLaw`."""
    if isinstance(gains, ObserverLaw):
        return dict(gains.weights)
    values = {}
    for name in GAINS:
        value = gains
        for part in name.split('.'):
            value = getattr(value, part)
        values[name] = value
    return values


def gains_of(values, where, law=None):
    """
    Return the gains of {name: value}, as `flat` returns it; `ConfigError` beginning with `where` if one is invalid.

    They are `RobustGains`; with `law`, an `ObserverLaw`, that law with other weights.
    """
    if isinstance(law, ObserverLaw):
        return law.model_copy(update={'weights': parse_config(values, ObserverWeights, where=where, context=None)})
    nested = {}
    for name, value in values.items():
        group, _, inner = name.rpartition('.')
        (nested.setdefault(group, {}) if group else nested)[inner] = value
    return parse_config(nested, RobustGains, where=where, context=None)


def gains_to_msg(gains):
    """Return `RobustGains` as a message."""
    return RobustGainsMessage(**{name.replace('.', '_'): value for name, value in flat(gains).items()})


def gains_from_msg(message, where):
    """Return the `RobustGains` of a message; `ConfigError` beginning with `where` if one is invalid."""
    return gains_of({name: getattr(message, name.replace('.', '_')) for name in GAINS}, where)


class GainParameters:
    """
    Declares the gains as parameters of `node` and applies their changes.

    A change is refused, with the reason of the `PkmError`, if a value is invalid or `check(gains)` raises one. All
    values of one `set_parameters_atomically` are checked and applied together.

    Parameters
    ----------
    node : PkmNode
    gains : RobustGains or ObserverLaw
        Values without parameter overrides.
    check, apply : callable
        Called with the new gains before and after they are set.

    """

    def __init__(self, node, gains, check, apply):
        self._node, self._where = node, node.get_fully_qualified_name()
        self._check, self._apply = check, apply
        self._law, described = gains, GAINS | WEIGHTS
        self._values = {name: node.tunable(name, value, described[name]) for name, value in flat(gains).items()}
        self.gains = self._gains_of(self._values)
        check(self.gains)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after_set)

    def take(self, gains):
        """Set all parameters to `gains` together; `PkmError` if they are refused."""
        parameters = [Parameter(name, value=value) for name, value in flat(gains).items()]
        result = self._node.set_parameters_atomically(parameters)
        if not result.successful:
            raise PkmError(result.reason)

    def _with(self, parameters):
        return self._values | {each.name: each.value for each in parameters if each.name in self._values}

    def _gains_of(self, values):
        return gains_of(values, self._where, self._law)

    def _on_set(self, parameters):
        try:
            self._check(self._gains_of(self._with(parameters)))
        except PkmError as refusal:
            return SetParametersResult(successful=False, reason=str(refusal))
        return SetParametersResult(successful=True)

    def _after_set(self, parameters):
        values = self._with(parameters)
        if values != self._values:
            self._values, self.gains = values, self._gains_of(values)
            self._apply(self.gains)
