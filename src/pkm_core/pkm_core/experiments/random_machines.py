"""Results of a learning law on random plants with unchanged controllers and models."""

from dataclasses import dataclass

import numpy as np

from pkm_core.plant.random_truth import random_machine
from pkm_core.simulation.cycles import run_cycles


@dataclass(frozen=True)
class Study:
    """Results of each machine."""

    error: np.ndarray  # (machines, cycles) [m] max dynamic error, worst axis
    settling_time_5um: np.ndarray  # (machines, cycles) [s] worst axis
    notices: tuple[str, ...]  # of the monitors, with the number of the machine

    def converged(self, cycles=10):
        """Return each machine's mean error (machines,) [m] over its last `cycles`."""
        return self.error[:, -cycles:].mean(axis=1)


def study(machine, trajectory, gains, law, *, machines=50, cycles=20, seed=1, environment='nominal'):
    """
    Return the `Study` of `law` on `machines` random machines; other arguments as for `run_cycles`.

    Machine k of a seed is the same for every law.
    """
    error, settling, notices = np.zeros((machines, cycles)), np.zeros((machines, cycles)), []
    for number in range(machines):
        records = drive_one(machine, trajectory, gains, law, number, cycles, seed, environment)
        error[number] = records.metric('max_dynamic_error').max(axis=1)
        settling[number] = records.metric('settling_time_5um').max(axis=1)
        notices += [f'machine {number}: {notice}' for notice in records.notices]
    return Study(error, settling, tuple(notices))


def drive_one(machine, trajectory, gains, law, number, cycles, seed=1, environment='nominal'):
    """Return the `CycleRecords` of the random machine `number` of a `seed`; other arguments as for `run_cycles`."""
    with random_machine(machine, (seed, number), environment) as drawn:
        return run_cycles(drawn, trajectory, gains, law, cycles, seed + number, environment)
