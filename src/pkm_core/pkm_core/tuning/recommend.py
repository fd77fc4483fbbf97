"""Result of a search: one design per joint, evaluated again on the fine grid, as a file for `load_control`."""

import numpy as np

from pkm_core.control.filters import Lag, Notch
from pkm_core.control.margins import stability_margins, worst_margins
from pkm_core.control.robust import RobustGains
from pkm_core.errors import PkmError

_DIGITS = 6  # of every value in the file
_FINALISTS = 200  # candidates evaluated on the fine grid before the search fails


def recommended(problem, branches):
    """
    Return (gains, Margins, worst Margins) of the candidate of one joint with the least J that satisfies all limits.

    Raises
    ------
    PkmError
        If there is none; the message has the least violation.

    """
    points = np.concatenate([branch.points for branch in branches])
    figures = np.concatenate([branch.figures for branch in branches])
    objective, violation = problem.objective(figures), problem.violations(figures).max(axis=1)
    kept = np.flatnonzero(violation <= 0)
    for index in kept[np.argsort(objective[kept], kind='stable')][:_FINALISTS]:
        gains = _rounded(problem.gains(points[index]))
        margins = stability_margins(gains, problem.model, problem.sample_time)
        worst = worst_margins(gains, problem.model, problem.sample_time)
        limits = problem.config.limits
        if _keeps(margins, limits.nominal) and _keeps(worst, limits.perturbed):
            return gains, margins, worst
    raise PkmError(
        f'{branches[0].joint}: none of {len(points)} candidates satisfies all limits; least violation '
        f'{100 * violation.min():.1f} %'
    )


def _keeps(margins, limits):
    return (
        margins.stable
        and margins.gain_margin >= limits.gain_margin
        and margins.phase_margin >= np.degrees(limits.phase_margin)
        and margins.peak_sensitivity <= limits.peak_sensitivity
    )


def _rounded(gains):
    def short(value):
        return float(f'{value:.{_DIGITS}g}')

    lag, notch = gains.lag, gains.notch
    return RobustGains(
        kp=short(gains.kp),
        ki=short(gains.ki),
        kd=short(gains.kd),
        derivative_filter=short(gains.derivative_filter),
        lag=Lag(pole=short(lag.pole), zero=short(lag.zero), dc_gain=short(lag.dc_gain)),
        notch=Notch(centre=short(notch.centre), width=short(notch.width), attenuation=short(notch.attenuation)),
    )


def control_yaml(machine_name, designs, origin):
    """Return the text of a config/control file; `designs` is {joint: result of `recommended`}, `origin` one line."""
    lines = [f'# Feedback of {machine_name}: {origin}', 'joints:']
    for joint, (gains, margins, worst) in designs.items():
        lag, notch = gains.lag, gains.notch
        lines += [
            f'  {joint}:  # {_in_words(margins)}; perturbed {_in_words(worst)}',
            f'    kp: {gains.kp / 1e3:.{_DIGITS}g} V/mm  # tuned',
            f'    ki: {gains.ki / 1e3:.{_DIGITS}g} V/(mm s)  # tuned',
            f'    kd: {gains.kd / 1e3:.{_DIGITS}g} V s/mm  # tuned',
            f'    derivative_filter: {gains.derivative_filter * 1e6:.{_DIGITS}g} us  # tuned',
            '    lag:',
            f'      pole: {lag.pole:.{_DIGITS}g} Hz  # tuned',
            f'      zero: {lag.zero:.{_DIGITS}g} Hz  # tuned',
            f'      dc_gain: {lag.dc_gain}  # chosen: the loop gain is in kp (thesis: 10 with gains per count)',
            '    notch:',
            f'      centre: {notch.centre:.{_DIGITS}g} Hz  # tuned',
            f'      width: {notch.width:.{_DIGITS}g} Hz  # tuned',
            f'      attenuation: {notch.attenuation:.{_DIGITS}g} dB  # tuned',
        ]
    return '\n'.join(lines) + '\n'


def _in_words(margins):
    return f'GM {margins.gain_margin:.2f} dB, PM {margins.phase_margin:.1f} deg, Smax {margins.peak_sensitivity:.2f}'
