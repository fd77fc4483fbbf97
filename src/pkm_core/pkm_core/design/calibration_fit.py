"""
The fit of a calibration: the most probable errors of a machine, and how probable a set of errors makes the readings.

Unknowns are scaled by their tolerances. The laser's datum is unknown and removed with the mean over the poses.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pkm_core.design.geometry import read_by_laser
from pkm_core.design.specimen import end_point

_STEP = 1e-6  # [m, rad, m/m] of the central differences; their relative error is 1e-9
_FEW = 13  # lengths and marks of the larger machine


@dataclass(frozen=True)
class Fit:
    """
    The fit of one set of unknowns.

    Attributes
    ----------
    priors : dict
        {name: standard deviation before} [m, rad, m/m].
    scaled : ndarray, shape (p,)
        Estimates in units of the priors.
    residuals : ndarray, shape (N, m)
        In units of the measurement's deviation.
    slope : ndarray, shape (N m, p)
        Derivative of the residuals at the estimate, by the scaled unknowns.
    slope_at_drawing : ndarray, shape (N m, p)

    """

    priors: dict
    scaled: np.ndarray
    residuals: np.ndarray
    slope: np.ndarray
    slope_at_drawing: np.ndarray

    @property
    def errors(self):
        """{name: estimate} [m, rad, m/m]."""
        values = np.array(list(self.priors.values())) * self.scaled
        return dict(zip(self.priors, values.tolist(), strict=True))

    @cached_property
    def _information(self):
        return self.slope.T @ self.slope + np.eye(len(self.scaled))

    @cached_property
    def covariance(self):
        """Covariance (p, p) of the estimates [m^2, ...]."""
        prior = np.array(list(self.priors.values()))
        return np.linalg.inv(self._information) * np.outer(prior, prior)

    @property
    def deviations(self):
        """{name: standard deviation of the estimate} [m, rad, m/m]."""
        return dict(zip(self.priors, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def misfit(self):
        """Root mean square of the residuals; about 1 for a valid model."""
        poses, coordinates = self.residuals.shape
        return float(np.sqrt(np.sum(self.residuals**2) / ((poses - 1) * coordinates)))

    @property
    def log_evidence(self):
        """
        Logarithm of the probability density of the measurements under the priors, less a constant of the measurements.

        Additional unknowns raise it only if they explain more than they could explain of noise. Source: MacKay,
        Bayesian interpolation, Neural Computation 4 (1992), with the Gaussian approximation at the estimate.
        """
        misfit = np.sum(self.residuals**2) + np.sum(self.scaled**2)
        return -0.5 * float(misfit + np.linalg.slogdet(self._information)[1])


def read(machine, q, errors):
    """Return the pose (..., m) of a specimen with `errors`, as a laser with those errors reads it."""
    return read_by_laser(machine, end_point(machine, q, errors), errors)


def fit(machine, measurements, priors, deviation):
    """Return the `Fit` of the unknowns `priors` to `measurements` with the standard `deviation` (m,)."""
    from scipy.optimize import least_squares

    names, prior = tuple(priors), np.array(list(priors.values()))

    def model(scaled):
        return dict(zip(names, prior * scaled, strict=True))

    def residuals(scaled):
        predicted = read(machine, measurements.q, model(scaled))
        return np.concatenate([_weighted(predicted - measurements.displacement, deviation).ravel(), scaled])

    def slope(scaled):
        S = _derivatives(machine, measurements.q, names, prior * scaled)
        data = _weighted(S, np.asarray(deviation)[:, np.newaxis]).reshape(-1, len(names)) * prior
        return np.vstack([data, np.eye(len(names))])

    # the singular values that 'trf' takes of dozens of unknowns need seconds of a loaded host
    method = 'trf' if len(names) <= _FEW else 'lm'
    found = least_squares(
        residuals, np.zeros(len(names)), slope, method=method, x_scale=1.0, xtol=1e-12, ftol=1e-12, gtol=1e-10
    )
    rows = slice(None, -len(names))
    return Fit(
        priors,
        found.x,
        found.fun[rows].reshape(measurements.displacement.shape),
        found.jac[rows],
        slope(np.zeros(len(names)))[rows],
    )


def _derivatives(machine, q, names, errors):
    """Return d read / d error (N, m, p) at `q` (N, n) and `errors` (p,), by central differences in one call."""
    steps = np.concatenate([_STEP * np.eye(len(names)), -_STEP * np.eye(len(names))])
    moved = dict(zip(names, (errors + steps).T[..., np.newaxis], strict=True))
    ahead, behind = np.split(read(machine, q, moved), 2)
    return np.moveaxis(ahead - behind, 0, -1) / (2.0 * _STEP)


def _weighted(values, deviation):
    """Return `values` (N, m, ...) less their mean over the poses (the unknown datum), over `deviation`."""
    return (values - values.mean(axis=0)) / deviation
