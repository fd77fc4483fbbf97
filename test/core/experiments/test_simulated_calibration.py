"""A calibration in simulation: the tool is where it is sent, by the truth at other poses; rows of the targets."""

import numpy as np
import pytest

from pkm_core.design.calibration import calibrate
from pkm_core.design.measurement import load_laser
from pkm_core.design.pose_plan import spread_poses
from pkm_core.design.tolerances import load_tolerances
from pkm_core.errors import PkmError
from pkm_core.experiments.rest_targets import LIMITS, SPECIMENS, rest_rows, rest_tasks
from pkm_core.experiments.simulated_calibration import TrueSpecimen, measure_study, simulate_calibration
from pkm_core.machines import load_machine
from pkm_core.machines.identity import Specimen
from pkm_core.simulation.calibration import measure_poses

PLANAR = load_machine('planar')


@pytest.mark.parametrize('environment', ['nominal', 'hard'])
def test_calibrated_machine_rests_where_it_is_sent(environment):
    """The targets at 12 of the 50 poses, for one specimen; `pkm experiment targets` has fifty."""
    done = simulate_calibration(PLANAR, 3, environment, 20, others=12)
    rms, largest = (limit * 1e-6 for limit in LIMITS[environment])
    assert (np.sqrt(np.mean(done.after**2, axis=0)) <= rms).all()
    assert (np.abs(done.after) <= largest).all()
    assert np.abs(done.before).max() > 5e-6
    assert done.measurements.specimen == Specimen.simulated('planar', 3, environment)
    assert 0.5 < done.calibration.misfit < 1.5


def test_measured_specimen_is_the_one_that_the_plant_builds():
    """The estimates are its errors, within three deviations; the lengths of the next seed are not."""
    true, other = (TrueSpecimen(PLANAR, seed, 'nominal').errors for seed in (3, 4))
    laser = load_laser()
    seen = measure_study(PLANAR, 16, load_tolerances(), laser, 3, 'nominal')
    found = calibrate(PLANAR, seen, load_tolerances(), seen.noise(PLANAR, laser))
    off = {name: [abs(found.errors[name] - errors[name]) / deviation for errors in (true, other)]
           for name, deviation in found.deviations.items()}  # fmt: skip
    assert max(own for own, _ in off.values()) < 3.0
    assert max(foreign for _, foreign in off.values()) > 10.0


def test_machine_of_another_specimen_is_not_measured():
    found = simulate_calibration(PLANAR, 3, 'nominal', 8, others=4).calibration.machine
    with pytest.raises(PkmError, match='are of specimen planar, seed 3, environment nominal; the machine in use is'):
        measure_poses(found, spread_poses(PLANAR, 4, 1), load_laser(), 4)


def test_rows_have_the_worst_specimen_and_coordinate():
    tasks = rest_tasks('planar', 1)
    assert len(tasks) == len(LIMITS) * SPECIMENS
    good = {
        'before': np.array([8e-6, 1e-6]),
        'after': np.array([0.2e-6, 0.1e-6]),
        'largest': np.array([0.5e-6, 0.2e-6]),
    }
    bad = good | {'largest': np.array([0.5e-6, 0.7e-6])}
    rows = list(rest_rows('planar', 'planar', {'rest nominal': [good, bad], 'rest hard': [good, bad]}))
    assert [met for *_, met in rows] == [False, True]
    assert rows[0][2] == 'x 0.20 (0.50), y 0.10 (0.70) um; drawing 8.0, 1.0'
