"""The linear law of one axis, PID with filtered derivative and the filters behind it, as a frequency response."""

from dataclasses import dataclass
from typing import ClassVar

from pkm_core.control.systems import pid_system
from pkm_core.control.uncertainty import UNIDENTIFIED, Uncertainty


class AxisLaw:
    """
    A linear law of one axis, error [m] to voltage [V].

    A feedforward is added in front of the filters `stages`; `pid_response` is the response of what is in front of them,
    `response` that of the whole law. `uncertainty` is that of the models on which it must be stable.
    """

    uncertainty: ClassVar[Uncertainty] = UNIDENTIFIED

    @property
    def stages(self):
        """The filters behind the feedforward, in their order; none here."""
        return ()

    @property
    def dc_gain(self):
        """Gain of the filters `stages` at rest."""
        return 1.0

    def on(self, model):
        """Return the law for another `AxisModel`: this one, unless it is designed from the model."""
        return self


class PidLaw(AxisLaw):
    """PID with gains kp [V/m], ki [V/(m s)], kd [V s/m], derivative_filter [s] and, in series, the filters `stages`."""

    kp: float
    ki: float
    kd: float
    derivative_filter: float

    def system(self, sample_time):
        """Return the whole law as a discrete `System`."""
        return pid_system(self, sample_time)

    def pid_response(self, z, sample_time, *, integral=1.0, derivative=1.0):
        """Return KP + `integral` I + `derivative` D [V/m] at the points `z` of the unit circle, z = 1 excluded."""
        tau, difference = self.derivative_filter, 1 - 1 / z
        slope = self.kd * difference / (sample_time + tau * difference)
        return self.kp + integral * self.ki * sample_time / difference + derivative * slope

    def response(self, z, sample_time):
        """Return the whole law [V/m], PID and filters, at the points `z` of the unit circle, z = 1 excluded."""
        response, delay = self.pid_response(z, sample_time), 1 / z
        for stage in self.stages:
            b0, b1, b2, a1, a2 = stage.discrete(sample_time)
            response = response * (b0 + delay * (b1 + delay * b2)) / (1 + delay * (a1 + delay * a2))
        return response


@dataclass(frozen=True)
class Pid(PidLaw):
    """A law without filters."""

    kp: float
    ki: float
    kd: float
    derivative_filter: float = 0.0
