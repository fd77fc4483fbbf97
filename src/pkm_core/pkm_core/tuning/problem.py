"""
The optimisation problem of tuning a robust controller: candidates, objective (7.30) and limits.

    J = DGM + DPM + DCLBW + max|S| up to the target CLBW + D

DGM, DPM and DCLBW are the shortfalls from the targets, relative to the targets. Kv, Ka, Kj are not searched: they
follow from the model. (7.30) has no term for a constant force, and its search then decreases KI and KP. The last term D
is the rms position after a step of force, D = (w^2.5/K) sqrt(INT |P S/jw|^2 df) with w the target CLBW, dimensionless.
Margins and resonance peaks are limits, for the model and for every perturbed model.
"""

import numpy as np

from pkm_core.control.filters import Lag, Notch
from pkm_core.control.robust import RobustGains
from pkm_core.tuning.evaluation import AxisFigures, by_name, violations

_GUARD = 0.005  # share by which the limits of the search are tightened: its grid is coarser than that of the margins


class TuningProblem:
    """
    Tuning of one axis: candidates are points u of the unit cube, uniform in the logarithm of `Bounds`.

    Parameters
    ----------
    config : TuningConfig
    model : AxisModel
    sample_time : float
        Ts [s].

    """

    limits = 9  # columns of `violations`

    def __init__(self, config, model, sample_time):
        self.config, self.model, self.sample_time = config, model, sample_time
        bounds = np.log([bound for _, bound in config.bounds])
        self._low, self._width = bounds[:, 0], bounds[:, 1] - bounds[:, 0]
        self.parameters = self._low.size
        self.figures = AxisFigures(
            model, sample_time, bandwidth=config.targets.bandwidth, resonances_from=config.limits.resonances_from
        )

    def gains(self, u):
        """Return the `RobustGains` at the point `u` (9,) of the unit cube."""
        x = dict(zip(type(self.config.bounds).model_fields, np.exp(self._low + u * self._width).tolist(), strict=True))
        kd = 2 * np.pi * x['speed_crossover'] / self.model.gain
        kp = 2 * np.pi * x['derivative_zero'] * kd
        return RobustGains(
            kp=kp,
            ki=2 * np.pi * x['integral_zero'] * kp,
            kd=kd,
            derivative_filter=1 / (2 * np.pi * x['derivative_pole']),
            lag=Lag(pole=x['lag_pole'], zero=x['lag_pole'] * x['lag_ratio'], dc_gain=1.0),
            notch=Notch(centre=x['notch_centre'], width=x['notch_width'], attenuation=x['notch_attenuation']),
        )

    def rounded(self, gains, digits):
        """Return `gains` with `digits` significant digits of every value."""

        def short(value):
            return float(f'{value:.{digits}g}')

        lag, notch = gains.lag, gains.notch
        return RobustGains(
            kp=short(gains.kp),
            ki=short(gains.ki),
            kd=short(gains.kd),
            derivative_filter=short(gains.derivative_filter),
            lag=Lag(pole=short(lag.pole), zero=short(lag.zero), dc_gain=short(lag.dc_gain)),
            notch=Notch(centre=short(notch.centre), width=short(notch.width), attenuation=short(notch.attenuation)),
        )

    def evaluate(self, points):
        """Return the figures (m, COLUMNS) of the candidates `points` (m, 9)."""
        return np.array([self.figures(self.gains(u)) for u in points])

    def objective(self, figures):
        """Return J (m,) of `figures` (m, COLUMNS)."""
        f, targets = by_name(figures), self.config.targets
        shortfall = (
            np.maximum(0, 1 - f['gain_margin'] / targets.gain_margin)
            + np.maximum(0, 1 - f['phase_margin'] / np.degrees(targets.phase_margin))
            + np.maximum(0, 1 - np.nan_to_num(f['bandwidth']) / targets.bandwidth)
        )
        return shortfall + f['band_sensitivity'] + f['disturbance']

    def violations(self, figures):
        """Return the relative violations (m, 9) of the limits by `figures` (m, COLUMNS); allowed up to 0."""
        return violations(figures, self.config.limits, guard=_GUARD)

    def lines(self, gains):
        """Yield the lines of an axis in a file of config/control."""
        lag, notch = gains.lag, gains.notch
        yield f'    kp: {gains.kp / 1e3:.6g} V/mm  # tuned'
        yield f'    ki: {gains.ki / 1e3:.6g} V/(mm s)  # tuned'
        yield f'    kd: {gains.kd / 1e3:.6g} V s/mm  # tuned'
        yield f'    derivative_filter: {gains.derivative_filter * 1e6:.6g} us  # tuned'
        yield '    lag:'
        yield f'      pole: {lag.pole:.6g} Hz  # tuned'
        yield f'      zero: {lag.zero:.6g} Hz  # tuned'
        yield f'      dc_gain: {lag.dc_gain}  # chosen: the loop gain is in kp (thesis: 10 with gains per count)'
        yield '    notch:'
        yield f'      centre: {notch.centre:.6g} Hz  # tuned'
        yield f'      width: {notch.width:.6g} Hz  # tuned'
        yield f'      attenuation: {notch.attenuation:.6g} dB  # tuned'
