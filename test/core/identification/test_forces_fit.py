"""Fit of friction, ripple and cogging to slow moves, compared with the truth, and the model file that holds them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.identification.forces_fit import fit_forces
from pkm_core.identification.identify import identify_joint
from pkm_core.identification.model_file import write_model
from pkm_core.identification.plan import Request, plan
from pkm_core.machines import load_machine
from pkm_core.plant.truth import load_truth
from pkm_core.simulation.experiment import SimulatedCell


@cache
def found(environment='nominal'):
    """Return machine, models and the `AxisIdentification` of d1 from slow moves alone."""
    machine = load_machine('planar')
    models, gains = load_model(machine), load_control(machine)
    request = Request(joints=('d1',), kind='low_frequency')
    cell = SimulatedCell(machine, gains, 1, environment)
    records = [cell.run(experiment) for experiment in plan(machine, request, models, gains)['d1']]
    return machine, models, identify_joint(machine, 'd1', records, models, gains)


@pytest.mark.parametrize('environment', ['nominal', 'hard'])
def test_forces_are_those_of_the_machine(environment):
    """Without a sweep, H is not known; its delay remains in the fit."""
    machine, _, axis = found(environment)
    truth, levels = load_truth(machine, environment)
    forces = axis.forces.forces
    volt = machine.thrust_per_volt * (1 + truth.axes['d1'].gain_error)
    # friction varies by 3 % (nominal) and 10 % (hard) from cycle to cycle, and the record is one cycle
    assert forces.coulomb * volt == pytest.approx(levels.coulomb_friction, rel=0.06 + levels.friction_jitter)
    assert forces.pitch == pytest.approx(truth.drive.pitch, rel=0.04)
    ripple = np.hypot(forces.ripple_sine, forces.ripple_cosine)
    cogging = np.hypot(forces.cogging_sine, forces.cogging_cosine) * volt
    assert ripple == pytest.approx(levels.ripple, rel=0.15)
    assert cogging == pytest.approx(levels.cogging, rel=0.25)
    presliding = levels.coulomb_friction / truth.friction.stiffness
    assert 0.6 * presliding < forces.slip < 2 * presliding
    assert axis.forces.residual < 0.3 * axis.forces.unexplained


def test_ideal_machine_has_no_forces():
    forces = found('ideal')[2].forces.forces
    assert forces.coulomb < 1e-3  # [V]; nominal is 0.045
    assert max(abs(forces.ripple_sine), abs(forces.ripple_cosine)) < 2e-3


def test_motion_in_one_direction_gives_no_forces():
    _, _, axis = found()
    assert fit_forces(axis.moves, replace(axis.low, friction=np.nan), axis.low_known) is None


def test_model_file_holds_the_forces(tmp_path):
    machine, models, axis = found()
    written = write_model(tmp_path / 'model.yaml', machine, {'d1': axis}, models, 'a test')
    read = load_model(machine, tmp_path / 'model.yaml')
    assert read == written
    assert read['d3'].forces is None  # not identified, and the file in use has none
    assert read['d1'].forces.coulomb == pytest.approx(axis.forces.forces.coulomb, rel=1e-4)
    text = (tmp_path / 'model.yaml').read_text()
    assert '      coulomb: ' in text
    assert '# +- ' in text
