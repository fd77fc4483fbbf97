"""
All figures of a design, of its model and the worst over the perturbed models, in a fraction of a millisecond.

The responses of the plants are computed once per axis. A candidate costs its own response and one pass over each
Nyquist curve.
"""

import numpy as np
from numba import njit

from pkm_core.control.margins import is_guide_known, perturbed_models, unit_circle
from pkm_core.control.nyquist import FIGURES, loop_figures
from pkm_core.control.systems import plant_system
from pkm_core.control.uncertainty import UNIDENTIFIED

_NOMINAL = len(FIGURES)
COLUMNS = (  # figures of a candidate: of the model, then the worst over the perturbed models
    *FIGURES,
    *('band_sensitivity', 'disturbance', 'resonance_peak'),
    *('worst_gain_margin', 'worst_phase_margin', 'worst_peak_sensitivity', 'worst_resonance_peak', 'unstable'),
)


@njit(cache=True)
def _evaluate(frequency, controller, plants, spread, start_angle, mode_index, band_index, weight, out):
    """
    Write the COLUMNS of one candidate into `out`.

    `controller` (m,) [V/m] and `plants` (p, m) [m/V] are responses at `frequency` (m,) [Hz], that of the model first;
    `start_angle` (p,) is the phase of L at 0 Hz;
    `spread` (g,) are the factors of the gain, 1 first; `weight` (m,) converts |P S|^2 to the squared D.
    """
    figures, n = np.empty(_NOMINAL), _NOMINAL
    out[n + 3], out[n + 4], out[n + 5], out[n + 6], out[n + 7] = np.inf, np.inf, 0.0, 0.0, 0.0
    for p in range(plants.shape[0]):
        loop = controller * plants[p]
        peak = np.abs(loop[mode_index:]).max()
        for g in range(spread.size):
            loop_figures(frequency, loop, spread[g], start_angle[p], figures)
            if p == 0 and g == 0:
                out[:n] = figures
                out[n + 2] = peak
            out[n + 3] = min(out[n + 3], figures[1])
            out[n + 4] = min(out[n + 4], figures[3])
            out[n + 5] = max(out[n + 5], figures[4])
            out[n + 6] = max(out[n + 6], peak * spread[g])
            out[n + 7] += abs(figures[0]) > 1.0  # 0 or a multiple of pi
    band, disturbance = 0.0, 0.0
    for k in range(frequency.size):
        sensitivity = 1.0 / abs(1.0 + controller[k] * plants[0, k])
        if k < band_index:
            band = max(band, sensitivity)
        disturbance += weight[k] * (abs(plants[0, k]) * sensitivity) ** 2
    out[n], out[n + 1] = band, np.sqrt(disturbance)


class AxisFigures:
    """
    Evaluation of the loops of one axis.

    Parameters
    ----------
    model : AxisModel
    sample_time : float
        Ts [s].
    bandwidth : float
        Target CLBW [Hz]; 'band_sensitivity' is the largest |S| up to it.
    resonances_from : float
        'resonance_peak' is the largest |L| from this frequency on [Hz].
    uncertainty : Uncertainty
        Of the model.

    """

    def __init__(self, model, sample_time, *, bandwidth, resonances_from, uncertainty=UNIDENTIFIED):
        self._sample_time = sample_time
        self._frequency = frequency = _search_grid(model, sample_time)
        self._z = unit_circle(frequency, sample_time)
        self._gains = np.array(uncertainty.gains)
        shapes = perturbed_models(model, (1.0,), uncertainty)
        systems = [plant_system(each, sample_time) for each in shapes]
        # poles of L at z = 1: position, integral and, without viscosity, speed
        poles = [2 + (model.viscosity == 0)] * len(systems)
        if is_guide_known(model):
            systems.append(plant_system(model, sample_time, stuck=True))
            poles.append(1)  # a guide at rest holds the position: integral alone
        self._plants = np.array([system(self._z) for system in systems])
        self._start_angle = -0.5 * np.pi * np.array(poles)
        w, wanted = 2 * np.pi * frequency, 2 * np.pi * bandwidth
        self._weight = np.gradient(frequency) * (wanted**2.5 / model.gain / w) ** 2
        self._mode_index = int(np.searchsorted(frequency, resonances_from))
        self._band_index = int(np.searchsorted(frequency, bandwidth, side='right'))

    def __call__(self, law):
        """Return the COLUMNS (n,) of a `PidLaw` with integral action."""
        figures = np.empty(len(COLUMNS))
        _evaluate(
            self._frequency, law.response(self._z, self._sample_time), self._plants, self._gains,
            self._start_angle, self._mode_index, self._band_index, self._weight, figures,
        )  # fmt: skip
        return figures


def _search_grid(model, sample_time):
    """Return frequencies [Hz] in steps of 2 %, and of 1/12 of its width in the range of each mode."""
    modes = [
        np.arange(0.87 * mode.resonance, 1.07 * mode.resonance, 2 * mode.resonance_damping * mode.resonance / 12)
        for mode in model.modes
    ]
    nyquist = 0.5 / sample_time
    grid = np.concatenate([np.geomspace(0.5, 20.0, 30), np.geomspace(20.5, nyquist, 190), *modes])
    return np.unique(np.minimum(grid, nyquist))


def by_name(figures):
    """Return {column: (m,)} of `figures` (m, COLUMNS)."""
    return dict(zip(COLUMNS, figures.T, strict=True))


def violations(figures, limits, *, peaks=True, guard=0.0):
    """
    Return the relative violations (m, k) of `AllLimits` by `figures` (m, COLUMNS); allowed up to 0.

    The limits are tightened by the share `guard`. `peaks`: whether the limits of the resonance peaks are included.
    """
    f = by_name(figures)
    columns = [f['unstable']]
    for keep, prefix in ((limits.nominal, ''), (limits.perturbed, 'worst_')):
        columns += [
            1 + guard - f[f'{prefix}gain_margin'] / keep.gain_margin,
            1 + guard - f[f'{prefix}phase_margin'] / np.degrees(keep.phase_margin),
            f[f'{prefix}peak_sensitivity'] / keep.peak_sensitivity - 1 + guard,
        ]
        if peaks:
            columns.append(f[f'{prefix}resonance_peak'] / keep.resonance_peak - 1 + guard)
    return np.stack(columns, axis=1)
