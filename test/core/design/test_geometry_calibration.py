"""Calibration with guides, scales and laser axes: what it reaches, how the set of unknowns is chosen, its file."""

import numpy as np
import pytest

from pkm_core.design.budget_monte_carlo import study_poses
from pkm_core.design.calibration import calibrate, prediction_errors
from pkm_core.design.calibration_file import write_calibrated_machine
from pkm_core.design.calibration_fit import fit
from pkm_core.design.geometry import geometry_names, geometry_priors
from pkm_core.design.information import parameter_priors
from pkm_core.design.measurement import Measurements
from pkm_core.design.tolerances import load_tolerances
from pkm_core.design.verification import verify
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.plant.specimen import assemble
from pkm_core.plant.truth import load_truth

FOUR_DOF, PLANAR = load_machine('four_dof'), load_machine('planar')
TOLERANCES = load_tolerances()
ARM = {'four_dof': np.array([1.0, 1.0, 1.0, 20.0]), 'planar': np.ones(2)}  # phi on 50 mm
LASER, ENCODER = 80e-9, 40e-9  # [m] of an average, as a calibration in the cell has


def true_pose(specimen, q):
    return specimen.end_point(q - specimen.encoder_offset, np.zeros((len(q), 0)))


def measured(machine, environment, seed, poses=40):
    """Return a specimen of the plant and averaged measurements of it with their deviation."""
    specimen, draw = assemble(machine, *load_truth(machine, environment), seed), np.random.default_rng(seed)
    q = study_poses(machine, poses, seed)
    pose = true_pose(specimen, q + ENCODER * draw.standard_normal(q.shape))
    axes = np.eye(len(machine.coordinates)) if specimen.laser_axes is None else specimen.laser_axes
    seen = (pose - pose[0]) @ axes.T + LASER * ARM[machine.name] * draw.standard_normal(pose.shape)
    return specimen, Measurements(q, seen), np.hypot(LASER, ENCODER) * ARM[machine.name]


def rms_at_other_poses(machine, specimen):
    wanted = machine.drawing.forward(study_poses(machine, 50, seed=999))
    off = true_pose(specimen, machine.inverse(wanted)) - wanted
    return (off - off.mean(axis=0)).std(axis=0) / ARM[machine.name]


@pytest.mark.parametrize('machine', [FOUR_DOF, PLANAR], ids=lambda machine: machine.name)
def test_full_calibration_reaches_the_target_on_real_geometry(machine):
    for seed in (1, 2):
        specimen, seen, deviation = measured(machine, 'geometric', seed)
        found = calibrate(machine, seen, TOLERANCES, deviation)
        assert set(found.priors) == set(parameter_priors(machine, TOLERANCES)) | set(geometry_names(machine))
        assert found.misfit < 1.3
        assert rms_at_other_poses(found.machine, specimen).max() < 0.3e-6


def test_lengths_alone_on_real_geometry_are_refused():
    """The refusal names coordinates and poses; the same measurements pass with the full set."""
    _, seen, deviation = measured(FOUR_DOF, 'geometric', 1)
    with pytest.raises(PkmError, match=r'misfit \d+\.\d+ of the noise; allowed 1\.5; residuals .* x \d.*pose \d+ '):
        calibrate(FOUR_DOF, seen, TOLERANCES, deviation, geometry='lengths')
    assert calibrate(FOUR_DOF, seen, TOLERANCES, deviation, geometry='full').misfit < 1.3


@pytest.mark.parametrize('machine', [FOUR_DOF, PLANAR], ids=lambda machine: machine.name)
def test_nominal_machine_is_calibrated_by_lengths_alone(machine):
    """The choice between the sets never makes a machine of straight guides worse: its bits are those of 'lengths'."""
    for seed in range(4):
        _, seen, deviation = measured(machine, 'nominal', seed)
        chosen, lengths = (calibrate(machine, seen, TOLERANCES, deviation, geometry=set) for set in ('auto', 'lengths'))
        assert chosen.errors == lengths.errors
        assert chosen.machine.config.built.geometry is None


def test_stated_deviations_cover_the_errors_of_geometry():
    """Scales, turns, height and laser axes; a guide's waves are no polynomials, so they have no true coefficient."""
    scores = []
    for seed in range(12):
        specimen, seen, deviation = measured(FOUR_DOF, 'geometric', seed, poses=60)
        found = calibrate(FOUR_DOF, seen, TOLERANCES, deviation, geometry='full')
        true = dict(zip(('square', 'pitch', 'roll', 'height'), specimen.turned, strict=True))
        true |= {f'scale_{joint}': scale for joint, scale in zip(FOUR_DOF.joints, specimen.scale, strict=True)}
        true |= {f'laser_{"xyz"[i]}{"xyz"[j]}': specimen.laser_axes[i, j] for i in range(3) for j in range(3) if i != j}
        scores += [(found.errors[name] - error) / found.deviations[name] for name, error in true.items()]
    assert np.std(scores) == pytest.approx(1.0, abs=0.25)  # 168 scores, correlated within a machine
    assert np.abs(scores).max() < 4.5


def test_laser_axes_are_found_and_carried_by_the_machine():
    specimen, seen, deviation = measured(FOUR_DOF, 'geometric', 3, poses=60)
    found = calibrate(FOUR_DOF, seen, TOLERANCES, deviation)
    off = np.abs(found.machine.laser_axes - specimen.laser_axes)
    assert off.max() < 50e-6 < np.abs(specimen.laser_axes - np.eye(4)).max()


def test_verification_compares_along_the_axes_of_the_laser():
    """Without them, an axis off by 100 urad looks like an error of the calibrated machine of a micrometre."""
    _, seen, deviation = measured(FOUR_DOF, 'geometric', 3, poses=60)
    used, held = seen.split()
    found = calibrate(FOUR_DOF, used, TOLERANCES, deviation).machine
    verified = verify(FOUR_DOF, found, held, deviation)
    assert verified.accepted
    assert (verified.after < 2.0 * deviation).all()
    along_base = prediction_errors(found.forward, held).std(axis=0)
    assert (along_base[:3] > 4.0 * verified.after[:3]).any()


def test_evidence_is_that_of_a_linear_gaussian_model():
    """Against the density of the measurements, whose covariance is noise plus the spread of the unknowns."""
    _, seen, deviation = measured(PLANAR, 'geometric', 4, poses=12)

    def density(priors):
        found = fit(PLANAR, seen, priors, deviation)
        rows = found.slope
        linear = found.residuals.ravel() - rows @ found.scaled  # of the drawing
        covariance = np.eye(len(rows)) + rows @ rows.T
        return -0.5 * (linear @ np.linalg.solve(covariance, linear) + np.linalg.slogdet(covariance)[1]), found

    lengths = parameter_priors(PLANAR, TOLERANCES)
    for priors in (lengths, lengths | geometry_priors(PLANAR, TOLERANCES)):
        expected, found = density(priors)
        assert found.log_evidence == pytest.approx(expected, rel=1e-3)


def test_machine_file_with_geometry_round_trips(tmp_path):
    _, seen, deviation = measured(FOUR_DOF, 'geometric', 1)
    found = calibrate(FOUR_DOF, seen, TOLERANCES, deviation)
    path = tmp_path / 'four_dof.yaml'
    write_calibrated_machine(path, 'four_dof', found, 'a test')
    again = load_machine(path)
    assert again.drawing.config == FOUR_DOF.config
    q = study_poses(FOUR_DOF, 50, seed=5)
    np.testing.assert_allclose(again.forward(q), found.machine.forward(q), rtol=0.0, atol=1e-7)  # rad; nanometres
    np.testing.assert_allclose(again.laser_axes, found.machine.laser_axes, atol=1e-12)
    write_calibrated_machine(tmp_path / 'again.yaml', path, found, 'a test')
    assert (tmp_path / 'again.yaml').read_text() == path.read_text()


def test_full_set_without_its_tolerances_is_refused():
    _, seen, deviation = measured(PLANAR, 'nominal', 1)
    without = TOLERANCES.model_copy(update={'geometry': None})
    assert calibrate(PLANAR, seen, without, deviation).machine.config.built.geometry is None
    with pytest.raises(PkmError, match='tolerances: no section geometry'):
        calibrate(PLANAR, seen, without, deviation, geometry='full')
    with pytest.raises(PkmError, match="geometry: 'all' given; allowed: auto, lengths, full"):
        calibrate(PLANAR, seen, TOLERANCES, deviation, geometry='all')
