"""
From a machine nobody knows to a learned motion: identify, tune, check, apply, accept, learn.

The steps are run on a bench: a machine with its controllers, simulated without ROS (`SimulatedBench`) or as a cell of
nodes. A bench has

    start(name)                          let the controllers take up the files that are installed now
    identify(on_step) -> Identified      find the models of all axes
    move(cycles, law, on_step) -> [[AxisMetrics a joint] a cycle]
"""

from dataclasses import dataclass, field
from pathlib import Path

from pkm_core.commissioning.candidates import Candidate, candidates
from pkm_core.commissioning.measured import MeasuredResponse, check_measured
from pkm_core.control.margins import Margins
from pkm_core.control.model import AxisModel, load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.tuning.tune import tune


@dataclass(frozen=True)
class Identified:
    """What a bench says of its axes."""

    model_file: Path  # pictures are beside it
    responses: dict[str, list[MeasuredResponse]]  # by joint
    warnings: list[str]


@dataclass
class Commissioning:
    """What has happened so far; a move is a list of cycles, each with the `AxisMetrics` of every joint."""

    limit: float  # [m] of the acceptance move
    as_found: list  # a move with the controllers as they were
    believed: dict[str, AxisModel]  # before
    identified: Identified | None = None
    models: dict[str, AxisModel] = field(default_factory=dict)  # as identified
    candidates: dict[str, list[Candidate]] = field(default_factory=dict)  # by joint
    measured: dict[str, dict[str, Margins]] = field(default_factory=dict)  # by joint and response
    tuned: list = field(default_factory=list)  # the acceptance move
    reasons: list[str] = field(default_factory=list)  # why the new gains were not kept; none if they were
    restored: list = field(default_factory=list)  # a move after the old gains have come back
    learned: list = field(default_factory=list)
    not_learned: str = ''  # why, if the new gains were kept and learning failed

    @property
    def accepted(self):
        """Whether the new gains were kept."""
        return bool(self.tuned) and not self.reasons


def commission(machine, bench, place, config, *, law, cycles, limit, seed, executor, folder, on_step):
    """
    Commission `machine` and return what happened, a `Commissioning`.

    Nothing new is applied before it has been checked on the measured responses, and nothing is kept that fails the
    acceptance move: then the files that were found come back, and one more move shows that they have.

    Parameters
    ----------
    machine : Machine
        What stands on the bench.
    bench : object
        See above.
    place : ConfigCopy
        Where models and gains are installed.
    config : TuningConfig
        What the loops are tuned for.
    law : str
        Learning law.
    cycles : int
        Of learning.
    limit : float
        Largest dynamic error [m] of any axis in the acceptance move, which nothing has been learned for.
    seed : int
        Of the search.
    executor : concurrent.futures.Executor
        That it runs on.
    folder : Path
        Takes the search and the gains.
    on_step : callable
        ``on_step(what, share)`` with the share of this step that is done, 0 to 1.

    Raises
    ------
    PkmError
        If the machine cannot be moved with the controllers as found, or cannot be identified; nothing has changed then.

    """
    bench.start('as_found')
    gains = load_control(machine)
    on_step('the motion as found', 0.0)
    story = Commissioning(limit, bench.move(1, 'none', on_step), load_model(machine))
    story.identified = bench.identify(on_step)
    try:
        control = _design(machine, story, place, config, gains, seed, executor, folder, on_step)
        if not story.reasons:
            place.install(None, control)
            bench.start('tuned')
            on_step('acceptance move', 0.0)
            story.tuned = bench.move(1, 'none', on_step)
            story.reasons = _excess(machine, story.tuned[0], limit)
    except PkmError as error:
        story.reasons.append(str(error))
    if story.reasons:
        place.restore()
        bench.start('restored')
        on_step('the motion with the old gains', 0.0)
        story.restored = bench.move(1, 'none', on_step)
    else:
        try:
            story.learned = bench.move(cycles, law, on_step)
        except PkmError as error:  # the gains have passed all the same
            story.not_learned = str(error)
    return story


def _design(machine, story, place, config, gains, seed, executor, folder, on_step):
    """Install the models, search gains for them, fill in `story`, and return the file of the gains."""
    place.install(story.identified.model_file, None)
    story.models = load_model(machine)
    total = len(machine.joints) * config.search.restarts * config.search.generations

    def on_progress(branches):
        on_step('tuning', sum(branch.generations for branch in branches) / total)

    on_step('tuning', 0.0)
    tuned = tune(machine, config, seed, executor, folder, on_progress=on_progress)
    story.candidates = candidates(machine, config, story.models, gains, folder)
    for joint, axis in tuned.items():
        responses, limits = story.identified.responses[joint], config.limits.perturbed
        story.measured[joint], reasons = check_measured(
            joint, axis.gains, story.models[joint], responses, limits, machine.sample_time
        )
        story.reasons += reasons
    return folder / f'{machine.name}.yaml'


def _excess(machine, metrics, limit):
    """Return, as texts, which axes err by more than `limit` [m] in a cycle."""
    return [
        f'{joint}: acceptance move errs by {1e6 * axis.max_dynamic_error:.1f} um; allowed {1e6 * limit:g} um'
        for joint, axis in zip(machine.joints, metrics, strict=True)
        if not axis.max_dynamic_error <= limit
    ]
