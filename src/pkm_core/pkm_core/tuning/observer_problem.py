"""
The optimisation problem of tuning an observer law: candidates are weights, the objective is D of (7.30)'s problem.

D is the rms position after a step of force, dimensionless (problem.py). Margins and resonance peaks are limits, for the
model and for every model of its uncertainty. The search multiplies all noises by one factor without any effect, so the
noise of the encoder is fixed.
"""

import numpy as np

from pkm_core.control.observer_design import ObserverLaw, ObserverWeights
from pkm_core.errors import PkmError
from pkm_core.tuning.evaluation import COLUMNS, AxisFigures, by_name, violations

_GUARD = 0.005  # as problem.py
_HOPELESS = 1e3  # of the figures of weights without a design


class ObserverProblem:
    """
    Tuning of one axis: candidates are points u of the unit cube, uniform in the logarithm of `ObserverBounds`.

    Parameters
    ----------
    config : ObserverTuning
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
            model,
            sample_time,
            bandwidth=config.bandwidth,
            resonances_from=config.limits.resonances_from,
            uncertainty=ObserverLaw.uncertainty,
        )

    def gains(self, u):
        """Return the `ObserverLaw` at the point `u` of the unit cube."""
        values = np.exp(self._low + u * self._width).tolist()
        found = dict(zip(type(self.config.bounds).model_fields, values, strict=True))
        return self._law({**found, 'encoder_noise': self.config.encoder_noise})

    def rounded(self, gains, digits):
        """Return `gains` with `digits` significant digits of every weight."""
        return self._law({name: float(f'{value:.{digits}g}') for name, value in gains.weights})

    def _law(self, weights):
        return ObserverLaw(weights=ObserverWeights(**weights), model=self.model)

    def evaluate(self, points):
        """Return the figures (m, COLUMNS) of the candidates `points`."""
        found = np.full((len(points), len(COLUMNS)), _HOPELESS)
        for row, u in zip(found, points, strict=True):
            try:
                row[:] = self.figures(self.gains(u))
            except PkmError:  # no design: unstable, and beyond every limit
                row[[COLUMNS.index(name) for name in COLUMNS if name.endswith('margin')]] = -_HOPELESS
        return found

    def objective(self, figures):
        """Return J (m,), here D, of `figures` (m, COLUMNS)."""
        return by_name(figures)['disturbance']

    def violations(self, figures):
        """Return the relative violations (m, 9) of the limits by `figures` (m, COLUMNS); allowed up to 0."""
        return violations(figures, self.config.limits, guard=_GUARD)

    def lines(self, gains):
        """Yield the lines of an axis in a file of config/control/observer."""
        w = gains.weights
        yield f'    effort: {_text(1e6 * w.effort)} um/V  # tuned'
        yield f'    speed: {_text(1e3 * w.speed)} ms  # tuned'
        yield f'    force_noise: {_text(1e3 * w.force_noise)} mV  # tuned'
        yield f'    drift: {_text(1e3 * w.drift)} mV  # tuned'
        yield f'    encoder_noise: {_text(1e6 * w.encoder_noise)} um  # fixed: only ratios of the noises have an effect'
        yield f'    mode_noise: {_text(1e6 * w.mode_noise)} um  # tuned'
        yield f'    mode_damping: {_text(w.mode_damping)}  # tuned'


def _text(value):
    return f'{value:.6g}'
