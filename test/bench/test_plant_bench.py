"""
The rigid 4-DOF machine against MuJoCo, an independent model that closes the loops link by link.

`test/bench/plant.py` is the bench; these tests check the part that must hold.
"""

import numpy as np
import pytest

from pkm_core.experiments.closed_chain import MujocoChain, forces, reference, step_rigid
from pkm_core.machines import load_machine

MACHINE = load_machine('four_dof')
FORCE = forces(MACHINE)


@pytest.fixture(scope='module')
def exact():
    return reference(MACHINE, FORCE)


def test_plant_rule_is_of_second_order(exact):
    """Its error against the exact motion falls with the square of the step."""
    coarse, fine = (np.abs(step_rigid(MACHINE, FORCE, substeps) - exact).max() for substeps in (4, 8))
    assert fine < 0.1e-9
    assert coarse / fine == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize(
    ('integrator', 'substeps', 'tolerance'),
    [
        ('RK4', 1, 1e-6),  # measured: 1.4 nm
        ('RK4', 10, 1e-9),  # measured: 0.014 nm, so the models are the same
        ('Euler', 100, 1e-6),  # first order; measured: 0.7 um
    ],
)
def test_mujoco_moves_the_same_closed_chain_along_the_same_path(integrator, substeps, tolerance, exact):
    pytest.importorskip('mujoco', reason='MuJoCo is not installed; test/bench/plant.py has the command')
    path = MujocoChain(MACHINE, integrator, substeps).step(FORCE)
    assert np.abs(exact[-1] - MACHINE.home).min() > 5e-3
    assert np.abs(path - exact).max() < tolerance
