"""
The genetic algorithm of the tuning: pymoo's GA, divided into pure functions that any executor can run.

One call takes a population and returns it some generations later. Generation g of a branch draws its random numbers
from the seed (seed, joint, restart, g). The result depends neither on the number of processes nor on interruptions.
Children come from a differential crossover: with simulated binary crossover, pymoo's default, searches of the same axis
ended 5 to 10 % apart, because good changes of a loop change several parameters together. The crossover is implemented
here, because pymoo's own (DEX of 0.6.2) repairs children outside the bounds without the seed.
"""

import json
import os
import time
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from pkm_core.errors import PkmError
from pkm_core.tuning.evaluation import COLUMNS

PIECE = 10  # generations
SAVE_EVERY = 2.0  # s, wall


@dataclass
class Branch:
    """One search for one joint: every candidate so far, in order."""

    joint: str
    restart: int
    points: np.ndarray  # (m, 9) in the unit cube
    figures: np.ndarray  # (m, COLUMNS)
    population: np.ndarray  # rows of the present population, best first
    generations: int  # done

    def grow(self, points, figures, population, generations):
        """Add the result of `advance` over `generations`."""
        rows = np.concatenate([self.population, np.arange(len(points)) + len(self.points)])
        self.population = rows[population]
        self.points, self.figures = np.vstack([self.points, points]), np.vstack([self.figures, figures])
        self.generations += generations


def advance(problem, points, figures, seed, generations):
    """
    Return the population after some generations and all children of these generations.

    Parameters
    ----------
    problem : TuningProblem
        The optimisation problem.
    points, figures : ndarray, shapes (m, 9), (m, COLUMNS)
        The population; no rows at the start.
    seed : sequence of int
        Seed of this branch.
    generations : range
        Numbers of the generations to run.

    Returns
    -------
    points, figures : ndarray
        Of the children, in order.
    population : ndarray of int, shape (n,)
        The survivors, best first: row numbers in the old population followed by the children.

    """
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.crossover import Crossover
    from pymoo.core.population import Population
    from pymoo.core.problem import Problem
    from pymoo.core.termination import NoTermination

    class DifferentialCrossover(Crossover):
        """One child of three parents: a + (b - c)/2 in nine of ten parameters, reflected into the unit cube."""

        def __init__(self):
            super().__init__(n_parents=3, n_offsprings=1, prob=1.0)

        def _do(self, _, parents, *args, random_state=None, **kwargs):
            a, b, c = parents
            mixed = 1 - np.abs(1 - np.abs(a + 0.5 * (b - c)))
            return np.where(random_state.random(a.shape) < 0.9, mixed, a)[None]

    def scored(individuals, figures):
        return individuals.set('F', problem.objective(figures)[:, None], 'G', problem.violations(figures))

    options = {}
    if len(points):
        options['sampling'] = scored(Population.new('X', points, 'index', np.arange(len(points))), figures)
    algorithm = GA(
        pop_size=problem.config.search.population,
        crossover=DifferentialCrossover(),
        termination=NoTermination(),
        **options,
    )
    algorithm.setup(Problem(n_var=problem.parameters, n_obj=1, n_ieq_constr=problem.limits, xl=0.0, xu=1.0))
    if len(points):
        algorithm.tell(infills=algorithm.ask())
    born, count = [], len(points)
    for generation in generations:
        algorithm.random_state = np.random.default_rng([*seed, generation])
        children = algorithm.ask()
        born.append((children.get('X').astype(np.float64), problem.evaluate(children.get('X'))))
        children.set('index', np.arange(count, count + len(children)))
        count += len(children)
        algorithm.tell(infills=scored(children, born[-1][1]))
    return *map(np.concatenate, zip(*born, strict=True)), algorithm.pop.get('index').astype(np.int64)


def new_branches(problems):
    """Return the branches of a new search: `restarts` per joint."""
    return [
        Branch(joint, restart, np.empty((0, problem.parameters)), np.empty((0, len(COLUMNS))), np.empty(0, np.int64), 0)
        for joint, problem in problems.items()
        for restart in range(problem.config.search.restarts)
    ]


def run_search(problems, branches, seed, executor, *, save, on_progress):
    """
    Advance all `branches` to the configured generations, in place.

    Parameters
    ----------
    problems : dict of str to TuningProblem
        By joint.
    branches : list of Branch
        Of `new_branches` or `read_branches`.
    seed : int
        Of the whole search.
    executor : concurrent.futures.Executor
        Of threads, processes, or of a dask client (``client.get_executor()``).
    save : callable
        ``save(branches)``, called every 2 s and at the end, also when the search is interrupted.
    on_progress : callable
        ``on_progress(branches)``, called every `PIECE` generations of a branch.

    """
    pending, saved = {}, time.monotonic()

    def submit(branch):
        problem = problems[branch.joint]
        words = [seed, list(problems).index(branch.joint), branch.restart]
        end = min(branch.generations + PIECE, problem.config.search.generations)
        piece, living = range(branch.generations, end), branch.population
        if piece:
            future = executor.submit(advance, problem, branch.points[living], branch.figures[living], words, piece)
            pending[future] = branch, len(piece)

    try:
        for branch in branches:
            submit(branch)
        while pending:
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                branch, generations = pending.pop(future)
                branch.grow(*future.result(), generations)
                on_progress(branches)
                submit(branch)
            if time.monotonic() - saved > SAVE_EVERY:
                save(branches)
                saved = time.monotonic()
    finally:
        for future in pending:
            future.cancel()
        save(branches)


def write_branches(path, branches, identity):
    """Write `branches` and the `identity` of their search (a JSON-compatible dict) to the .npz `path`, atomically."""
    arrays = {'identity': np.array(json.dumps(identity)), 'columns': np.array(COLUMNS)}
    for branch in branches:
        key = f'{branch.joint}/{branch.restart}'
        arrays[f'{key}/points'], arrays[f'{key}/figures'] = branch.points, branch.figures
        arrays[f'{key}/population'], arrays[f'{key}/generations'] = branch.population, np.array(branch.generations)
    partial = Path(f'{path}.partial')
    with partial.open('wb') as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # no array has the name allow_pickle
    os.replace(partial, path)  # an interrupted write keeps the old file


def read_branches(path, problems, identity):
    """Return the branches in the .npz `path`; `PkmError` unless its search has the same `identity`."""
    try:
        with np.load(path, allow_pickle=False) as file:
            stored = {name: file[name] for name in file.files}
        theirs = json.loads(str(stored['identity']))
        branches = new_branches(problems)
        for branch in branches:
            key = f'{branch.joint}/{branch.restart}'
            if f'{key}/points' in stored:  # a restart that the file does not have starts from generation 0
                branch.points, branch.figures = stored[f'{key}/points'], stored[f'{key}/figures']
                branch.population, branch.generations = stored[f'{key}/population'], int(stored[f'{key}/generations'])
    except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
        raise PkmError(f'{path}: is not a search of pkm tune: {error}') from None
    for name in identity:
        if theirs.get(name) != identity[name]:
            raise PkmError(f'{path}: {name} is {theirs.get(name)!r}; this search has {identity[name]!r}')
    return branches
