"""
How far the delay and the flexible modes let the natural frequency of computed torque go: why the thesis leaves it.

To one axis, the others being cancelled, computed torque is a PID without filters on K/(s (s + a)) H. The 0.75 ms of
computation and hold alone keep a rigid axis below some 40 Hz for the margins asked of the robust law; the modes, which
no notch lowers here, take up to half of that.
"""

import numpy as np

from pkm_core.tuning.evaluation import AxisFigures, by_name, violations


def scan(gains, model, sample_time, config, natural_frequencies):
    """
    Return the figures of the loop at each of `natural_frequencies` (m,) [Hz], {name: (m,)}.

    Damping and integral are those of `gains`, a `TorqueGains`; `config` is a `TuningConfig` with the limits. Besides
    `figures.COLUMNS` there are 'natural_frequency' and, as booleans, 'keeps_limits', 'keeps_margins' (all limits but
    those of the resonance peaks), 'stable_perturbed' and 'stable'.
    """
    judge = AxisFigures(
        model, sample_time, bandwidth=config.targets.bandwidth, resonances_from=config.limits.resonances_from
    )
    figures = np.array(
        [judge(gains.model_copy(update={'natural_frequency': f}).pid(model)) for f in natural_frequencies]
    )
    named = by_name(figures)
    return named | {
        'natural_frequency': np.asarray(natural_frequencies),
        'keeps_limits': (violations(figures, config.limits) <= 0).all(axis=1),
        'keeps_margins': (violations(figures, config.limits, peaks=False) <= 0).all(axis=1),
        'stable_perturbed': named['unstable'] == 0,
        'stable': np.abs(named['end_angle']) < 1,
    }


def limits_of(scanned):
    """Return the highest natural frequency [Hz] of a `scan` at which each of its booleans holds; nan if none."""
    names = ('keeps_limits', 'keeps_margins', 'stable_perturbed', 'stable')
    return {name: float(np.max(scanned['natural_frequency'][scanned[name]], initial=0.0)) or np.nan for name in names}
