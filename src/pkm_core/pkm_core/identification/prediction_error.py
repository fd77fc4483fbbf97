"""
The low-frequency model L = K/(s (s + a)) of (7.19) by the prediction-error method, from moves in closed loop.

In each stretch of one-way motion the model predicts the position from the voltage sent to the drive,

    y = K F(a) (u - reaction) + nuisance,   F(a) = sampled H wc/((s + wc) s (s + a)) with hold and computation,

with known H and current loop. The nuisance of a stretch is its initial position, its initial speed and a constant
acceleration. Between reversals Coulomb friction is constant, and so is the mean of cogging and gravity. The constants
of both directions differ by friction; their mean is the offset.

The voltage contains fed-back noise, so least squares is biased in closed loop. The equations are therefore correlated
with the reference, which is free of noise. The instruments are the reference and the reference filtered by 1/(s + a):
the directions in which K and a change the prediction.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import SATURATED
from pkm_core.identification.partial_fractions import SLOWEST
from pkm_core.identification.prediction import SHORTEST, moving_stretches, predict

_GUESSES = np.geomspace(0.1, 1000.0, 17)  # [1/s]
_ITERATIONS = 50
_CONVERGED = 1e-9  # relative
_COLLINEAR = 1e8  # condition number
_FEW = 4  # [stretches]
_USELESS = 0.2  # largest relative standard deviation of K: the gain error for which controllers are designed
# thresholds of warnings
_POOR_FIT = 98.0  # per cent
_POOR_GAIN, _POOR_VISCOSITY = 0.02, 0.1  # relative standard deviations


@dataclass(frozen=True)
class LowFrequencyFit:
    """Fitted L; `covariance` is that of (gain, viscosity), from the scatter between the stretches of motion."""

    gain: float  # K [m/s^2/V]
    viscosity: float  # a [1/s]
    covariance: np.ndarray  # (2, 2)
    friction: float  # [V] Coulomb; nan if all motion is in one direction
    offset: float  # [V] constant drive
    fit_percent: float  # [%] of the held-out stretches; nan without any
    residual: float  # [m] rms over the stretches of the fit
    used: int  # stretches in the fit
    held_out: int  # stretches held out
    instrument: bool  # whether the reference is the instrument
    warnings: tuple[str, ...]

    @property
    def deviations(self):
        """Standard deviations of gain and viscosity."""
        return np.sqrt(np.diag(self.covariance))


def fit_low_frequency(records, known):
    """
    Return the `LowFrequencyFit` to a list of `AxisData` of one axis; `known` is a `KnownDynamics`.

    With at least _FEW stretches every second pair is held out.

    Raises
    ------
    IdentificationError
        If there are fewer than two stretches of motion, they do not determine K and a, the drive is saturated in more
        than `SATURATED` of their samples, or the axis did not follow its reference.

    """
    for data in records:
        data.check_follows()
    stretches = [stretch for data in records for stretch in moving_stretches(data)]
    spare = {number for number in range(len(stretches)) if len(stretches) >= _FEW and number // 2 % 2}
    held_out = [stretches[number] for number in sorted(spare)]
    used = [stretch for number, stretch in enumerate(stretches) if number not in spare]
    if len(used) < 2:
        raise IdentificationError(
            f'{records[0].name}: {len(used)} stretches of one-way motion over {SHORTEST} samples; at least 2 are '
            f'needed (range of motion: {1e3 * max(np.ptp(data.position) for data in records):.3f} mm)'
        )
    _refuse_saturation(used)
    gain, viscosity, covariance = _solve(used, known)
    fit = predict(used, viscosity, known)
    constants = np.array([-each.constant(gain) / gain for each in fit])
    directions = np.array([stretch.direction for stretch in used])
    friction, offset = np.nan, float(constants.mean())
    if np.ptp(directions):
        columns = np.column_stack([np.ones(len(used)), directions])
        (offset, friction), *_ = np.linalg.lstsq(columns, constants, rcond=None)
    errors = np.concatenate([each.error(gain) for each in fit])
    percent = fit_percent(predict(held_out, viscosity, known), gain) if held_out else np.nan
    return LowFrequencyFit(
        gain=gain,
        viscosity=viscosity,
        covariance=covariance,
        friction=float(friction),
        offset=float(offset),
        fit_percent=percent,
        residual=float(np.sqrt(np.mean(errors**2))),
        used=len(used),
        held_out=len(held_out),
        instrument=all(data.reference is not None for data in records),
        warnings=tuple(_warnings(used, gain, viscosity, covariance, friction, percent)),
    )


def fit_percent(predictions, gain):
    """Return 100 (1 - |y - y_hat|/|y - mean y|) over all `predictions`."""
    error = sum(np.sum(each.error(gain) ** 2) for each in predictions)
    motion = sum(np.sum((each.measured - each.measured.mean()) ** 2) for each in predictions)
    return float(100 * (1 - np.sqrt(error / motion)))


def _refuse_saturation(used):
    """Refuse moves in which the recorded voltage is often not the one that acted."""
    count = sum(stretch.data.saturated(stretch.start, stretch.end) for stretch in used)
    share = count / sum(stretch.end - stretch.start for stretch in used)
    if share > SATURATED:
        data = used[0].data
        raise IdentificationError(
            f'{data.name}: the drive is saturated: {100 * share:.1f} % of the samples of the moves are at '
            f'{data.limit:g} V; allowed {100 * SATURATED:g} %'
        )


def _solve(used, known):
    """Return K, a and their covariance."""
    viscosity = min(_GUESSES, key=lambda guess: _least_squares(predict(used, guess, known))[1])
    gain, squares = _least_squares(predict(used, viscosity, known))
    _refuse_weak_instruments(used, known, gain, viscosity, squares)
    for _ in range(_ITERATIONS):
        equations, slopes, _ = _equations(used, known, gain, viscosity)
        step = _solved(used, slopes.sum(axis=0), -equations.sum(axis=0))
        before = gain, viscosity
        gain, viscosity = gain + step[0], float(np.clip(viscosity + step[1], 0.3 * viscosity, 3 * viscosity))
        if viscosity < SLOWEST:  # an axis without viscous friction
            viscosity = SLOWEST
            gain, _ = _least_squares(predict(used, viscosity, known))
            break
        if np.allclose(before, (gain, viscosity), rtol=_CONVERGED, atol=0):
            break
    else:
        raise IdentificationError(
            f'{used[0].data.name}: no K and a fit the moves: a does not converge, last value {viscosity:.3g} 1/s'
        )
    equations, slopes, _ = _equations(used, known, gain, viscosity)
    inverse = _solved(used, slopes.sum(axis=0), np.eye(2))
    scatter = equations.T @ equations * (len(used) / max(len(used) - 2, 1))
    return float(gain), float(viscosity), inverse @ scatter @ inverse.T


def _refuse_weak_instruments(used, known, gain, viscosity, squares):
    """Refuse moves that determine K worse than _USELESS; `squares` is the sum of squared errors."""
    _, slopes, moments = _equations(used, known, gain, viscosity)
    inverse = _solved(used, slopes.sum(axis=0), np.eye(2))
    variance = squares / sum(stretch.end - stretch.start for stretch in used)
    deviation = np.sqrt(variance * (inverse @ moments.sum(axis=0) @ inverse.T)[0, 0]) / abs(gain)
    if not deviation <= _USELESS:
        raise IdentificationError(
            f'{used[0].data.name}: the moves do not determine K and a: the uncertainty of K is '
            f'{100 * deviation:.0f} %; allowed {100 * _USELESS:.0f} %; vary their speed'
        )


def _solved(used, matrix, right):
    """Return the solution of the 2 x 2 equations; refuse moves that do not determine K and a."""
    scaled = matrix / np.linalg.norm(matrix, axis=0)
    if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > _COLLINEAR:
        raise IdentificationError(f'{used[0].data.name}: the moves do not determine K and a; vary their speed')
    return np.linalg.solve(matrix, right)


def _least_squares(predictions):
    """Return the least-squares gain and its sum of squared errors."""
    measured, driven = (
        np.concatenate([each.free(getattr(each, name)) for each in predictions]) for name in ('measured', 'driven')
    )
    gain = driven @ measured / (driven @ driven)
    return gain, float(np.sum((measured - gain * driven) ** 2))


def _equations(used, known, gain, viscosity):
    """Return, per stretch, instruments times error (m, 2), its derivative to K and a, instruments squared (m, 2, 2)."""
    step = 1e-4 * viscosity
    here, above, below = (predict(used, viscosity + shift, known) for shift in (0.0, step, -step))
    equations, slopes, moments = [], [], []
    for stretch, at, up, down in zip(used, here, above, below, strict=True):
        change = np.column_stack([-at.free(at.driven), (up.error(gain) - down.error(gain)) / (2 * step)])
        instruments = change
        if stretch.data.reference is not None:
            clean = stretch.of(stretch.data.reference)
            sample_time = stretch.data.sample_time
            slowed = lfilter([sample_time], [1, -np.exp(-viscosity * sample_time)], clean)
            instruments = np.column_stack([at.free(clean), at.free(slowed)])
        equations.append(instruments.T @ at.error(gain))
        slopes.append(instruments.T @ change)
        moments.append(instruments.T @ instruments)
    return np.array(equations), np.array(slopes), np.array(moments)


def _warnings(used, gain, viscosity, covariance, friction, percent):
    deviation = np.sqrt(np.diag(covariance))
    if len(used) < _FEW:
        yield f'{len(used)} stretches of motion in the fit; fewer than {_FEW} make its uncertainty unreliable'
    if not np.isfinite(percent):
        yield 'no stretch of motion was held out; the fit is not validated'
    elif percent < _POOR_FIT:
        yield f'L fits held-out moves to {percent:.1f} %; expected {_POOR_FIT:g} %'
    if deviation[0] > _POOR_GAIN * abs(gain):
        yield f'the uncertainty of K is {100 * deviation[0] / abs(gain):.1f} %; expected {100 * _POOR_GAIN:g} %'
    if deviation[1] > _POOR_VISCOSITY * viscosity:
        yield (
            f'a = {viscosity:.2f} +- {deviation[1]:.2f} 1/s: the moves are too slow or too short to determine viscous '
            f'friction'
        )
    if gain < 0:
        yield f'K = {gain:.4g} is negative: a positive drive moves the axis backwards; check the signs of both signals'
    if np.isnan(friction):
        yield 'all motion is in one direction: friction and offset cannot be separated'
    if any(stretch.data.reference is None for stretch in used):
        yield 'no reference recorded: the least-squares fit is biased if the loop was closed and the noise is not small'
    saturated = sum(stretch.data.saturated(stretch.start, stretch.end) for stretch in used)
    if saturated:
        yield f'{saturated} samples of the moves are at the limit of {used[0].data.limit:g} V'
