"""Random machines: only the plant differs, the seed determines it, and its files are removed."""

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError
from pkm_core.experiments.random_machines import study
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.random_truth import random_machine
from pkm_core.simulation.cycles import run_cycles

MACHINE = load_machine('planar')
GAINS = load_control(MACHINE)
TRAJECTORY = to_joints(MACHINE, plan(MACHINE, load_motion('planar_80ms')))


def counts(seed):
    """Return the readings of a first cycle; the same noise for all machines."""
    with random_machine(MACHINE, seed) as machine:
        return run_cycles(machine, TRAJECTORY, GAINS, None, 1, 1).counts


def test_seed_determines_the_random_machine():
    nominal = run_cycles(MACHINE, TRAJECTORY, GAINS, None, 1, 1).counts
    first = counts((1, 0))
    np.testing.assert_array_equal(counts((1, 0)), first)
    assert (counts((1, 1)) != first).any()
    assert (nominal != first).any()


def test_models_and_gains_of_controllers_do_not_change():
    with random_machine(MACHINE, 5) as machine:
        assert (load_model(machine), load_control(machine)) == (load_model(MACHINE), GAINS)


def test_copied_configuration_is_removed_after_the_block():
    before = MACHINE.configuration
    with random_machine(MACHINE, 5) as machine:
        assert machine.configuration.folder.is_dir()
        assert MACHINE.configuration == before != machine.configuration
    assert not machine.configuration.folder.exists()


def test_study_has_errors_by_machine_and_cycle():
    law = make_law('inverse', MACHINE, GAINS)
    found = study(MACHINE, TRAJECTORY, GAINS, law, machines=2, cycles=3)
    assert found.error.shape == found.settling_time_5um.shape == (2, 3)
    assert found.error[0, 0] != found.error[1, 0]
    assert (found.error[:, 2] < found.error[:, 0]).all()
    np.testing.assert_array_equal(found.converged(1), found.error[:, 2])


def test_unknown_environment_is_refused_by_name():
    refusal = "environment 'storm' is unknown; known: .*'nominal'"
    with pytest.raises(ConfigError, match=refusal), random_machine(MACHINE, 1, 'storm'):
        pass
