"""Clock of the laser against the ticks of the machine, both from tick 0, in whole nanoseconds."""

import numpy as np


def nanoseconds(time):
    """Return `time` [s] in whole nanoseconds."""
    return round(time * 1e9)


def sample_numbers(machine, first_tick, end_tick):
    """
    Return the numbers k of the laser samples that are due from `first_tick` on and before `end_tick`.

    Sample k is due k laser sample times after tick 0.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> sample_numbers(load_machine('four_dof'), 8, 16)  # ticks of 0.5 ms, samples of 0.8 ms: from 4 to 8 ms
    array([5, 6, 7, 8, 9])

    """
    tick, sample = nanoseconds(machine.sample_time), nanoseconds(machine.laser_sample_time)
    return np.arange(-(-first_tick * tick // sample), -(-end_tick * tick // sample))
