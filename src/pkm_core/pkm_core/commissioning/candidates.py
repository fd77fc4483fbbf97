"""Candidate gains of an axis, each with its cost on the identified model, and the recommended one."""

from dataclasses import dataclass, replace

import numpy as np

from pkm_core.control.margins import Margins, stability_margins, worst_margins
from pkm_core.control.robust import RobustGains
from pkm_core.errors import PkmError
from pkm_core.tuning.evaluation import violations
from pkm_core.tuning.problem import TuningProblem
from pkm_core.tuning.recommend import recommended
from pkm_core.tuning.search import Branch
from pkm_core.tuning.tune import SEARCH_FILE

_MARGINS = ('gain margin', 'phase margin', 'peak sensitivity', 'resonance peak')
_LIMITS = ('stability', *_MARGINS, *(f'perturbed {name}' for name in _MARGINS))  # columns of `violations`


@dataclass(frozen=True)
class Candidate:
    """Gains of one axis and their figures on its model."""

    name: str
    gains: RobustGains
    objective: float  # J, (7.30)
    margins: Margins
    worst: Margins  # over the perturbed models
    beyond: tuple[str, ...]  # violated limits
    recommended: bool = False


def candidates(machine, config, models, as_found, folder):
    """
    Return {joint: [Candidate]}: the gains as found, then the best of every restart of the search in the order of J.

    The candidate with the least J is recommended; `tune` writes the same gains.

    Parameters
    ----------
    machine : Machine
        The machine under commissioning.
    config : TuningConfig
        Configuration of the search.
    models : dict of str to AxisModel
        The identified models.
    as_found : dict of str to RobustGains
        The gains in use.
    folder : Path
        Folder of the search written by `tune`, with the figures of all candidates.

    """
    found = {}
    with np.load(folder / SEARCH_FILE) as search:
        for joint, model in models.items():
            problem, best = TuningProblem(config, model, machine.sample_time), []
            for restart in range(config.search.restarts):
                stored = (search[f'{joint}/{restart}/{name}'] for name in ('points', 'figures', 'population'))
                try:
                    gains, *_ = recommended(problem, [Branch(joint, restart, *stored, config.search.generations)])
                except PkmError:  # this restart has no valid candidate; `tune` has taken its gains from another one
                    continue
                best.append(_judged(problem, f'search {restart + 1}', gains))
            best.sort(key=lambda candidate: candidate.objective)
            best[0] = replace(best[0], recommended=True)
            found[joint] = [_judged(problem, 'as found', as_found[joint]), *best]
    return found


def _judged(problem, name, gains):
    figures = problem.figures(gains)[None]
    excess = violations(figures, problem.config.limits)[0]
    return Candidate(
        name,
        gains,
        float(problem.objective(figures)[0]),
        stability_margins(gains, problem.model, problem.sample_time),
        worst_margins(gains, problem.model, problem.sample_time),
        tuple(limit for limit, value in zip(_LIMITS, excess, strict=True) if value > 0),
    )
