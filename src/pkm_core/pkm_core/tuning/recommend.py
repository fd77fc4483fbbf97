"""Result of a search: one design per joint, evaluated again on the fine grid, as a file for `load_control`."""

import numpy as np

from pkm_core.control.margins import stability_margins, worst_margins
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
        gains = problem.rounded(problem.gains(points[index]), _DIGITS)
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


def control_yaml(machine_name, designs, problems, origin):
    """
    Return the text of a file of gains.

    `designs` is {joint: result of `recommended`}, `problems` {joint: problem of its search}, `origin` one line.
    """
    lines = [f'# Feedback of {machine_name}: {origin}', 'joints:']
    for joint, (gains, margins, worst) in designs.items():
        lines.append(f'  {joint}:  # {_in_words(margins)}; perturbed {_in_words(worst)}')
        lines += problems[joint].lines(gains)
    return '\n'.join(lines) + '\n'


def _in_words(margins):
    return f'GM {margins.gain_margin:.2f} dB, PM {margins.phase_margin:.1f} deg, Smax {margins.peak_sensitivity:.2f}'
