"""Tune the controllers of single axes of a machine: search, recommend, write a file of config/control."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from pkm_core.control.margins import Margins
from pkm_core.control.model import AxisModel, load_model
from pkm_core.control.observer import load_observer
from pkm_core.control.pid import AxisLaw
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.thesis.gains import own_column
from pkm_core.tuning.config import structure_of
from pkm_core.tuning.evaluation import COLUMNS
from pkm_core.tuning.observer_problem import ObserverProblem
from pkm_core.tuning.problem import TuningProblem
from pkm_core.tuning.recommend import control_yaml, recommended
from pkm_core.tuning.search import new_branches, read_branches, run_search, write_branches

SEARCH_FILE = 'search.npz'
_OF_STRUCTURE = {'pid': (TuningProblem, load_control), 'observer': (ObserverProblem, load_observer)}


@dataclass(frozen=True)
class TunedAxis:
    """Recommended gains of one joint."""

    gains: AxisLaw
    model: AxisModel
    margins: Margins
    worst: Margins  # over the perturbed models
    objective: float  # J
    candidates: int
    column: tuple  # as thesis.gains.own_column; empty for an observer law, which the thesis does not have


def tune(machine, config, seed, executor, folder, *, resume=None, on_progress=lambda branches: None):
    """
    Search gains for every joint of `machine`, write them as FOLDER/<machine>.yaml and return {joint: TunedAxis}.

    FOLDER/search.npz has every candidate with its figures (arrays JOINT/RESTART/points, .../figures, columns). An
    interrupted search continues from such a file, `resume`. The result depends on models, `config` and `seed` only.

    Raises
    ------
    PkmError
        If the file to resume is of another search, FOLDER has a search that is not resumed, or no candidate of a joint
        satisfies the limits.

    """
    folder, models = Path(folder), load_model(machine)
    structure = structure_of(config)
    problem_of, load = _OF_STRUCTURE[structure]
    problems = {joint: problem_of(config, model, machine.sample_time) for joint, model in models.items()}
    identity = {
        'machine': machine.name,
        'seed': seed,
        'models': _digest({joint: model.model_dump() for joint, model in models.items()}, machine.sample_time),
        'figures': _digest(COLUMNS),
        'config': _digest(config.model_dump(exclude={'search': {'generations', 'restarts'}})),
    }
    if resume is None and (folder / SEARCH_FILE).exists():
        raise PkmError(f'{folder / SEARCH_FILE}: has a search; resume it or name another folder')
    branches = read_branches(resume, problems, identity) if resume else new_branches(problems)
    folder.mkdir(parents=True, exist_ok=True)
    run_search(
        problems,
        branches,
        seed,
        executor,
        save=lambda found: write_branches(folder / SEARCH_FILE, found, identity),
        on_progress=on_progress,
    )
    path = folder / f'{machine.name}.yaml'
    designs = {
        joint: recommended(problem, [branch for branch in branches if branch.joint == joint])
        for joint, problem in problems.items()
    }
    added = '' if structure == 'pid' else f' --structure {structure}'
    origin = f'pkm tune --machine {machine.name}{added} --seed {seed}'
    path.write_text(control_yaml(machine.name, designs, problems, origin), 'utf-8')
    gains = load(machine, str(path))
    return {
        joint: _summary(machine, gains[joint], designs[joint], problems[joint], branches, joint)
        for joint in machine.joints
    }


def _summary(machine, gains, design, problem, branches, joint):
    _, margins, worst = design
    figures = problem.figures(gains)[None]
    band = float(figures[0, COLUMNS.index('band_sensitivity')])
    return TunedAxis(
        gains,
        problem.model,
        margins,
        worst,
        float(problem.objective(figures)[0]),
        sum(len(branch.points) for branch in branches if branch.joint == joint),
        own_column(machine, gains, problem.model, margins, band) if isinstance(problem, TuningProblem) else (),
    )


def _digest(*parts):
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:12]
