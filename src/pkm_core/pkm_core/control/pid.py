"""The linear law of one axis, PID with filtered derivative and the filters behind it, as a frequency response."""

from dataclasses import dataclass


class PidLaw:
    """PID with gains kp [V/m], ki [V/(m s)], kd [V s/m], derivative_filter [s] and, in series, the filters `stages`."""

    kp: float
    ki: float
    kd: float
    derivative_filter: float

    @property
    def stages(self):
        """The filters behind the PID, in their order; none here."""
        return ()

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
