"""Covariance of a pose: spread of specimens around it, and its origin."""

import numpy as np
import pytest

from pkm_core.design.calibration import built_machine
from pkm_core.design.information import parameter_priors
from pkm_core.design.measurement import draw_specimen, load_laser
from pkm_core.design.pose_covariance import PoseCovariance
from pkm_core.design.specimen import end_point
from pkm_core.design.tolerances import load_tolerances
from pkm_core.machines import load_machine
from pkm_core.machines.identity import Specimen
from pkm_core.machines.uncertainty import Uncertainty

OFF_HOME = {'planar': [9e-3, -4e-3], 'four_dof': [6e-3, -3e-3, 2e-3, 5e-3]}


@pytest.mark.parametrize('name', OFF_HOME)
def test_uncalibrated_covariance_is_the_spread_of_specimens(name):
    """Of 1500 machines built to the tolerances: deviations of their poses within 8 % (four deviations)."""
    machine, tolerances = load_machine(name), load_tolerances()
    q = machine.home + OFF_HOME[name]
    specimens = [draw_specimen(machine, tolerances, seed) for seed in range(1500)]
    errors = {
        each: np.array([specimen[each] for specimen in specimens]) for each in parameter_priors(machine, tolerances)
    }
    moved = end_point(machine, q, errors) - end_point(machine, machine.home, errors)
    spread = PoseCovariance(machine)
    assert spread.origin == 'manufacturing tolerances'
    expected = np.sqrt(np.diag(spread.at(q)))
    assert expected == pytest.approx(moved.std(axis=0), rel=0.08)


def calibrated(deviation):
    planar = load_machine('planar')
    known = Uncertainty.of(('l2', 'l4'), np.diag([deviation**2, deviation**2]))
    return built_machine(planar, {}, Specimen.measured('planar'), known)


def test_calibrated_covariance_is_that_of_the_file():
    q = load_machine('planar').home + OFF_HOME['planar']
    wide, narrow = (PoseCovariance(calibrated(deviation)) for deviation in (10e-6, 1e-9))
    assert narrow.origin == 'calibration'
    readings = load_machine('planar').encoder_resolution ** 2 / 12.0 + load_laser().encoder_error ** 2
    J = load_machine('planar').jacobian(q)
    assert narrow.at(q) == pytest.approx(readings * (J @ J.T), rel=1e-3)
    assert (np.diag(wide.at(q)) > 10 * np.diag(narrow.at(q))).all()


def test_covariance_follows_the_joints():
    """It is kept for small motion only."""
    machine = load_machine('planar')
    spread = PoseCovariance(machine)
    near, far = machine.home + 1e-5, machine.home + OFF_HOME['planar']
    first = spread.at(machine.home)
    assert np.array_equal(spread.at(near), first)
    assert not np.allclose(spread.at(far), first, rtol=0.1, atol=0.0)
    assert np.array_equal(spread.at(far), PoseCovariance(machine).at(far))


def test_machine_without_links_has_the_errors_of_its_encoders():
    stage = load_machine('xy_stage')
    spread = PoseCovariance(stage)
    deviation = np.sqrt(stage.encoder_resolution**2 / 12.0 + load_laser().encoder_error ** 2)
    assert np.sqrt(np.diag(spread.at(stage.home))) == pytest.approx([deviation, deviation])
    assert spread.origin.startswith('encoders only')
