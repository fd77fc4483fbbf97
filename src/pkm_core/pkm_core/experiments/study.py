"""A whole experiment: every condition in every environment with every noise seed."""

from dataclasses import dataclass, replace

from pkm_core.experiments.condition import ENVIRONMENTS, conditions, environments
from pkm_core.experiments.outcome import Outcome


@dataclass(frozen=True)
class Study:
    """Results of an experiment: `outcomes` by name of a condition and environment, one per seed."""

    experiment: str
    arrangement: str
    seeds: int
    cycles: int  # counted cycles of each run
    outcomes: dict[tuple[str, str], list[Outcome]]

    def conditions(self, machine=None):
        """Return the `Condition`s, or those of `machine` alone."""
        return [each for each in conditions(self.experiment) if machine in (None, each.machine)]


def run_study(experiment, arrangement, drive, seeds, cycles):
    """
    Return the `Study` of 'planar' or 'four_dof' over noise seeds 1 to `seeds`.

    ``drive(runs, cycles)`` returns one `Outcome` per run, a tuple of condition and seed; `arrangement` is the name of
    its method.
    """
    wanted = [
        replace(condition, environment=environment)
        for environment in environments(experiment)
        for condition in conditions(experiment)
        if environment in ENVIRONMENTS or condition.machine == experiment
    ]
    runs = [(condition, seed) for condition in wanted for seed in range(1, seeds + 1)]
    outcomes = {(condition.name, condition.environment): [] for condition in wanted}
    for each in drive(runs, cycles):
        outcomes[each.condition.name, each.condition.environment].append(each)
    return Study(experiment, arrangement, seeds, cycles, outcomes)
