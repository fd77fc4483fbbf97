"""
Procedure from an unknown machine to a learned motion: identify, tune, check, apply, accept, calibrate, verify, learn.

The steps run on a bench: a machine with its controllers, simulated without ROS (`SimulatedBench`) or as a cell of
nodes. A bench has

    start(name)                          reload the installed files into the controllers
    identify(on_step) -> Identified      identify the models of all axes
    calibrate(on_step) -> Calibrated     measure the lengths by laser, verify them, and take them up
    move(cycles, law, on_step)           run cycles; return one list of `AxisMetrics` per cycle, one entry per joint
"""

from dataclasses import dataclass, field
from pathlib import Path

from pkm_core.commissioning.acceptance import excess
from pkm_core.commissioning.candidates import Candidate, candidates
from pkm_core.commissioning.measured import MeasuredResponse, check_measured
from pkm_core.control.margins import Margins
from pkm_core.control.model import AxisModel, load_model
from pkm_core.control.robust import load_control
from pkm_core.design.verification import Verification
from pkm_core.errors import PkmError
from pkm_core.tuning.tune import tune


@dataclass(frozen=True)
class Identified:
    """Result of the identification of all axes."""

    model_file: Path  # with the plots in the same folder
    responses: dict[str, list[MeasuredResponse]]  # by joint
    warnings: list[str]


@dataclass(frozen=True)
class Calibrated:
    """Result of a calibration by laser, and its verification at other poses."""

    machine_file: Path | None  # that the bench uses now; None: the former lengths stay in use
    reasons: list[str]  # why they stay in use
    misfit: float  # residuals over the noise
    verification: Verification


@dataclass
class Commissioning:
    """Results of the steps so far; a move is a list of cycles, each with the `AxisMetrics` of every joint."""

    limit: float  # [m] of the acceptance move
    as_found: list  # a move with the controllers as found
    previous_models: dict[str, AxisModel]  # in use before
    identified: Identified | None = None
    models: dict[str, AxisModel] = field(default_factory=dict)  # as identified
    candidates: dict[str, list[Candidate]] = field(default_factory=dict)  # by joint
    measured: dict[str, dict[str, Margins]] = field(default_factory=dict)  # by joint and response
    tuned: list = field(default_factory=list)  # the acceptance move
    reasons: list[str] = field(default_factory=list)  # for rejection of the new gains; empty if they were kept
    restored: list = field(default_factory=list)  # a move with the restored gains
    calibrated: Calibrated | None = None
    not_calibrated: str = ''  # the error, if the new gains were kept and the calibration failed
    learned: list = field(default_factory=list)
    not_learned: str = ''  # the error, if the new gains were kept and learning failed

    @property
    def accepted(self):
        """Whether the new gains were kept."""
        return bool(self.tuned) and not self.reasons


def commission(machine, bench, place, config, *, law, cycles, limit, seed, executor, folder, on_step, calibrate=True):
    """
    Commission `machine` and return the result, a `Commissioning`.

    New gains are applied only after a check on the measured responses, and kept only after the acceptance move.
    Otherwise the original files are restored, and one more move confirms it. With the new gains the lengths are
    calibrated by laser and the motion is learned; if the calibration is refused, the former lengths stay in use.

    Parameters
    ----------
    machine : Machine
        The machine on the bench.
    bench : object
        A bench as described in this module.
    place : ConfigCopy
        Configuration in which models and gains are installed.
    config : TuningConfig
        Configuration of the search.
    law : str
        Learning law.
    cycles : int
        Number of cycles of learning.
    limit : float
        Largest allowed dynamic error [m] of any axis in the acceptance move, without learned feedforward; the error
        that friction alone explains is added. No axis may be worse than as found.
    seed : int
        Seed of the search.
    executor : concurrent.futures.Executor
        Executor of the search.
    folder : Path
        Folder for the search and the gains.
    on_step : callable
        ``on_step(what, share)`` with the completed share of this step, 0 to 1.
    calibrate : bool
        Whether to calibrate.

    Raises
    ------
    PkmError
        If the machine cannot be moved with the controllers as found, or cannot be identified; no file is changed then.

    """
    bench.start('as_found')
    gains = load_control(machine)
    on_step('the motion as found', 0.0)
    outcome = Commissioning(limit, bench.move(1, 'none', on_step), load_model(machine))
    outcome.identified = bench.identify(on_step)
    try:
        tuned_file = _design(machine, outcome, place, config, gains, seed, executor, folder, on_step)
        if not outcome.reasons:
            place.install(None, tuned_file)
            bench.start('tuned')
            on_step('acceptance move', 0.0)
            outcome.tuned = bench.move(1, 'none', on_step)
            accepted = load_control(machine)
            outcome.reasons = excess(machine, outcome.as_found[0], outcome.tuned[0], limit, accepted, outcome.models)
    except PkmError as error:
        outcome.reasons.append(str(error))
    if outcome.reasons:
        place.restore()
        bench.start('restored')
        on_step('the motion with the old gains', 0.0)
        outcome.restored = bench.move(1, 'none', on_step)
        return outcome
    if calibrate:
        _calibrate(bench, place, outcome, on_step)
    try:
        outcome.learned = bench.move(cycles, law, on_step)
    except PkmError as error:  # the gains are kept
        outcome.not_learned = str(error)
    return outcome


def _calibrate(bench, place, outcome, on_step):
    """Calibrate on the `bench`, install an accepted machine file, and add the result to `outcome`."""
    on_step('calibration', 0.0)
    try:
        outcome.calibrated = bench.calibrate(on_step)
    except PkmError as error:  # the gains are kept
        outcome.not_calibrated = str(error)
        return
    if outcome.calibrated.machine_file is None:
        outcome.not_calibrated = '; '.join(outcome.calibrated.reasons)
    else:
        place.install_machine(outcome.calibrated.machine_file)


def _design(machine, outcome, place, config, gains, seed, executor, folder, on_step):
    """Install the models, search gains for them, add the results to `outcome`, and return the file of the gains."""
    place.install(outcome.identified.model_file, None)
    outcome.models = load_model(machine)
    total = len(machine.joints) * config.search.restarts * config.search.generations

    def on_progress(branches):
        on_step('tuning', sum(branch.generations for branch in branches) / total)

    on_step('tuning', 0.0)
    tuned = tune(machine, config, seed, executor, folder, on_progress=on_progress)
    outcome.candidates = candidates(machine, config, outcome.models, gains, folder)
    for joint, axis in tuned.items():
        responses, limits = outcome.identified.responses[joint], config.limits.perturbed
        outcome.measured[joint], reasons = check_measured(
            joint, axis.gains, outcome.models[joint], responses, limits, machine.sample_time
        )
        outcome.reasons += reasons
    return folder / f'{machine.name}.yaml'
