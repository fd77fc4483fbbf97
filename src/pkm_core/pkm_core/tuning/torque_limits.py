"""
Limits of the natural frequency of computed torque due to delay and flexible modes.

For one axis, with the others cancelled, computed torque is a PID without filters on K/(s (s + a)) H. With the margins
required of the robust law, the 0.75 ms of computation and hold alone limit a rigid axis to about 40 Hz. The modes,
which no notch attenuates here, reduce this by up to half. The thesis therefore continues with robust control.
"""

import numpy as np

from pkm_core.tuning.evaluation import AxisFigures, by_name, violations


def scan(gains, model, sample_time, config, natural_frequencies):
    """
    Return the figures of the loop at each of `natural_frequencies` (m,) [Hz], {name: (m,)}.

    Damping and integral are those of `gains`, a `TorqueGains`; `config` is a `TuningConfig` with the limits. In
    addition to `evaluation.COLUMNS` the result has 'natural_frequency' and the booleans 'keeps_limits', 'keeps_margins'
    (all limits except those of the resonance peaks), 'stable_perturbed' and 'stable'.
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
    """Return the highest natural frequency [Hz] of a `scan` at which each of its booleans is true; nan if none."""
    names = ('keeps_limits', 'keeps_margins', 'stable_perturbed', 'stable')
    return {name: float(np.max(scanned['natural_frequency'][scanned[name]], initial=0.0)) or np.nan for name in names}
