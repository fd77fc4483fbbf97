"""
Covariance of a pose computed by forward kinematics from encoder readings.

C(q) = D S D' + J R J', D = d(x(q) - x(home)) / d(lengths and marks), S their covariance, J the Jacobian, R rounding and
error of the encoders. It is that of the pose relative to the pose at home, where the laser has its datum: a calibration
does not see a common shift of all poses. Without a calibration S is that of the manufacturing tolerances.
"""

import numpy as np

from pkm_core.design.information import parameter_priors
from pkm_core.design.measurement import load_laser
from pkm_core.design.specimen import LINKS, end_point
from pkm_core.design.tolerances import load_tolerances
from pkm_core.machines.uncertainty import Uncertainty

_STEP = 1e-6  # [m] of the central differences; their relative error is 1e-9
_SAME = 2e-4  # [m] motion of an axis over which C is kept; it changes by 0.3 % at most, as lengths are 70 mm


class PoseCovariance:
    """
    The covariance of the poses of `machine`.

    Attributes
    ----------
    origin : str
        Where the covariance of the lengths comes from, in words.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> spread = PoseCovariance(planar).at(planar.home + [5e-3, 0.0])
    >>> (1e6 * np.sqrt(np.diag(spread))).round(1)  # um in x, y from the tolerances of the drawing
    array([1.5, 0.2])

    """

    def __init__(self, machine):
        self._machine = machine
        known = getattr(getattr(machine.config, 'built', None), 'uncertainty', None)
        mechanism = machine.config.mechanism
        if known is not None:
            self.origin = 'calibration'
        elif mechanism in LINKS:
            self.origin, known = 'manufacturing tolerances', _tolerances(machine)
        else:
            self.origin = 'encoders only; the mechanism has no links'
        self._names, self._lengths = (), np.zeros((0, 0))
        if known is not None:
            self._names, self._lengths = tuple(known.deviations), known.covariance
        self._reading = machine.encoder_resolution**2 / 12.0 + load_laser().encoder_error ** 2  # [m^2]
        self._at_home = self._sensitivities(machine.home)
        self._last = None  # q of the last covariance
        self._covariance = np.zeros((0, 0))

    def at(self, q):
        """Return C (m, m) [m^2, m rad, rad^2] at the joint positions `q` (n,) [m]."""
        if self._last is None or np.abs(q - self._last).max() > _SAME:
            moved, J = self._sensitivities(q) - self._at_home, self._machine.jacobian(q)
            self._covariance = moved @ self._lengths @ moved.T + self._reading * (J @ J.T)
            self._last = np.array(q)
        return self._covariance

    def _sensitivities(self, q):
        """Return d x / d(lengths and marks) (m, p) at `q`, all by one call."""
        count = len(self._names)
        if not count:
            return np.zeros((len(self._machine.coordinates), 0))
        steps = np.vstack([np.eye(count), -np.eye(count)]) * _STEP
        ahead, behind = np.split(end_point(self._machine, q, dict(zip(self._names, steps.T, strict=True))), 2)
        return (ahead - behind).T / (2.0 * _STEP)


def _tolerances(machine):
    """Return the `Uncertainty` of a machine built to config/design/tolerances.yaml."""
    deviations = parameter_priors(machine, load_tolerances())
    return Uncertainty.of(tuple(deviations), np.diag(np.square(list(deviations.values()))))
