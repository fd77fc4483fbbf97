"""Calibration: recovers a specimen within the stated uncertainty; identifiability, files, refusals."""

import re

import numpy as np
import pytest

from pkm_core.design.budget_monte_carlo import study_poses
from pkm_core.design.calibration import calibrate, positioning_errors, prediction_errors
from pkm_core.design.calibration_file import write_calibrated_machine
from pkm_core.design.measurement import (
    Measurements,
    draw_specimen,
    load_laser,
    read_measurements,
    simulate,
    write_measurements,
)
from pkm_core.design.specimen import end_point
from pkm_core.design.tolerances import load_tolerances
from pkm_core.design.verification import verify
from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.identity import Specimen
from pkm_core.plant.plant import Plant
from pkm_core.plant.specimen import assemble
from pkm_core.plant.truth import load_truth

FOUR_DOF, PLANAR = load_machine('four_dof'), load_machine('planar')
TOLERANCES, LASER = load_tolerances(), load_laser()


def measured(machine, seed, poses=60):
    errors = draw_specimen(machine, TOLERANCES, seed)
    return errors, simulate(machine, errors, LASER, study_poses(machine, poses, seed), seed)


def calibrated(machine, seen):
    return calibrate(machine, seen, TOLERANCES, LASER.deviation(machine, seen.q))


@pytest.fixture(scope='module')
def first():
    errors, seen = measured(FOUR_DOF, seed=1)
    used, held = seen.split()
    return errors, calibrated(FOUR_DOF, used), held


def test_stated_deviations_cover_the_errors_of_estimates():
    scores = []
    for seed in range(30):
        errors, seen = measured(FOUR_DOF, seed)
        found = calibrated(FOUR_DOF, seen)
        scores += [(found.errors[name] - errors[name]) / found.deviations[name] for name in errors]
    assert np.std(scores) == pytest.approx(1.0, abs=0.1)  # 390 scores, 13 of them correlated: 5 % of standard error
    assert np.abs(scores).max() < 4.5


@pytest.mark.parametrize('machine', [FOUR_DOF, PLANAR], ids=lambda machine: machine.name)
def test_calibration_errors_on_held_out_poses_are_within_noise(machine):
    errors, seen = measured(machine, seed=2)
    used, held = seen.split()
    found = calibrated(machine, used)
    assert found.misfit == pytest.approx(1.0, abs=0.2)
    noise = LASER.deviation(machine, held.q)
    before, after = (
        np.sqrt(np.mean(prediction_errors(forward, held) ** 2, axis=0))
        for forward in (machine.forward, found.machine.forward)
    )
    assert (before > 2.0 * noise).all()
    assert (after < 1.5 * noise).all()
    poses = machine.forward(study_poses(machine, 300, seed=99))
    off_before, off_after = (
        positioning_errors(machine, errors, inverse, poses) for inverse in (machine.inverse, found.machine.inverse)
    )
    assert (off_after.std(axis=0) < 0.15 * off_before.std(axis=0)).all()
    assert (off_after.std(axis=0) < noise).all()


def plant_specimen(seed):
    """Return the assembly of the plant of `seed`, and laser measurements of it at rest."""
    truth, levels = load_truth(FOUR_DOF, 'nominal')
    specimen = assemble(FOUR_DOF, truth, levels, seed)
    q = study_poses(FOUR_DOF, 60, seed=3)
    pose = specimen.end_point(q - specimen.encoder_offset, np.zeros((60, 0)))
    step = 0.91e-6 * np.array([1.0, 1.0, 1.0, 1.0 / 0.05])
    readings = step * np.round((pose - pose[0]) / step)
    return specimen, Measurements(q, readings, specimen=Specimen.simulated('four_dof', seed, 'nominal'))


def test_specimen_of_the_plant_is_calibrated():
    specimen, seen = plant_specimen(3)
    used, held = seen.split()
    found = calibrated(FOUR_DOF, used)
    after = prediction_errors(found.machine.forward, held)
    assert np.abs(after[:, :3]).max() < 1e-6
    for link, length in specimen.lengths.items():
        nominal = 0.1166 if link.startswith('k') else 0.07
        assert nominal + found.errors[link] == pytest.approx(length, abs=4.0 * found.deviations[link])


def test_undetermined_parameters_keep_the_drawing_values(first):
    """The unknown datum hides three directions; they are reported."""
    _, found, _ = first
    hidden = [parts for value, parts in found.identifiability.hardly_known(share=0.1) if value < 1e-6]
    assert [set(parts) for parts in hidden if 'dz' in parts] == [{'dz'}]  # height of the end-effector
    assert len(hidden) == 3
    # a shift of both sliders of a guide equals a shift of the other platform: only the datum of the end-effector moves
    assert {name for parts in hidden for name in parts} == {'dx', 'dy', 'dz', 'd1', 'd3', 'd5', 'd7'}
    assert found.errors['dz'] == pytest.approx(0.0, abs=1e-12)
    assert found.deviations['dz'] == pytest.approx(found.priors['dz'])
    assert found.deviations['l2'] < 0.5 * found.priors['l2']


def test_calibrated_inverse_kinematics_inverts_the_forward(first):
    _, found, _ = first
    q = study_poses(FOUR_DOF, 200, seed=4)
    np.testing.assert_allclose(found.machine.inverse(found.machine.forward(q)), q, atol=1e-13)


def test_calibrated_machine_file_keeps_the_drawing(first, tmp_path):
    """The file has every calibrated length and mark; calibrating from it again gives the same file."""
    _, found, _ = first
    path = tmp_path / 'four_dof.yaml'
    write_calibrated_machine(path, 'four_dof', found, 'a test')
    again = load_machine(path)
    assert again.name == 'four_dof'
    assert again.drawing.config == FOUR_DOF.config
    assert again.specimen == Specimen.measured('four_dof')  # the measurements do not name a simulated one
    # written to a nanometre
    assert again.config.built.lengths() == pytest.approx(found.machine.config.built.lengths(), abs=0.6e-9)
    assert dict(again.config.built.marks) == pytest.approx(dict(found.machine.config.built.marks), abs=0.6e-9)
    q = study_poses(FOUR_DOF, 50, seed=5)
    np.testing.assert_allclose(again.forward(q), found.machine.forward(q), rtol=0.0, atol=1e-7)  # rad; nanometres
    # written again from itself
    write_calibrated_machine(tmp_path / 'again.yaml', path, found, 'a test')
    assert (tmp_path / 'again.yaml').read_text() == path.read_text()


def file_of(found, path, specimen=None):
    """Write the calibrated machine `found`, of `specimen`, and return the path."""
    built = found.machine.config.built.model_copy(update={'specimen': specimen})
    config = found.machine.config.model_copy(update={'built': built})
    machine = type(found.machine)(config, found.machine.name, found.machine.configuration)
    write_calibrated_machine(path, found.machine.name, found._replace(machine=machine), 'a test')
    return path


def test_calibrated_machine_runs_its_own_specimen_only(first, tmp_path):
    known = load_machine(file_of(first[1], tmp_path / 'four_dof.yaml', Specimen.simulated('four_dof', 3, 'nominal')))
    assert Plant(known, 3, 'nominal').machine.specimen == known.specimen
    Plant(known.drawing, 4, 'hard')  # the drawing suits every specimen
    for seed, environment in ((4, 'nominal'), (3, 'hard')):
        text = (
            'the calibrated lengths are of specimen four_dof, seed 3, environment nominal; '
            f'the machine in use is four_dof, seed {seed}, environment {environment}; expected the same one'
        )
        with pytest.raises(PkmError, match=text):
            Plant(known, seed, environment)


def test_lengths_of_a_real_machine_are_not_simulated(first, tmp_path):
    known = load_machine(file_of(first[1], tmp_path / 'four_dof.yaml'))
    with pytest.raises(
        PkmError, match='of specimen four_dof, measured machine; the machine in use is four_dof, seed 1'
    ):
        Plant(known, 1, 'nominal')


def test_calibrated_file_of_another_machine_is_refused(first, tmp_path):
    path = file_of(first[1], tmp_path / 'second_arm.yaml', Specimen.simulated('four_dof', 3, 'hard'))
    with pytest.raises(
        ConfigError, match='lengths of four_dof, seed 3, environment hard; expected those of second_arm'
    ):
        load_machine(path)


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ('', r'built\.specimen: is missing; expected the machine that was measured'),
        ('{machine: four_dof, origin: simulated, seed: 1}', r'simulated with seed 1, environment None; expected both'),
        ('{machine: four_dof, origin: measured machine, seed: 1}', r'measured machine with seed 1'),
        ('{machine: four_dof, origin: found}', r"built\.specimen\.origin: 'found' given"),
        ('{machine: four_dof, origin: simulated, seed: -1, environment: hard}', r'built\.specimen\.seed: -1 given'),
    ],
)
def test_calibrated_file_with_a_bad_specimen_is_refused(first, given, message, tmp_path):
    path = file_of(first[1], tmp_path / 'four_dof.yaml')
    line = '  specimen: {machine: four_dof, origin: measured machine}\n'
    assert line in path.read_text()
    path.write_text(path.read_text().replace(line, f'  specimen: {given}\n' if given else ''))
    with pytest.raises(ConfigError, match=message):
        load_machine(path)


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('  l4: ', '  l5: ', r"unknown key 'built\.l5'; known: \['dx', "),
        ('  l4: 7', '  l4: 1.0 mm  # ', r'built\.l4 1 mm; allowed 69 to 71 mm'),
        ('  dz: ', '  dz: 12 mm  # ', r'built\.dz 12 mm; allowed 9 to 11 mm'),
        ('    d7: ', '    d7: -2 mm  # ', r'built\.marks\.d7 -2 mm; allowed -1 to 1 mm'),
        ('    d7: ', '    d7: 2  # ', r'built\.marks\.d7: 2 has no unit'),
    ],
)
def test_invalid_calibrated_machine_file_is_refused(first, old, new, message, tmp_path):
    path = tmp_path / 'four_dof.yaml'
    write_calibrated_machine(path, 'four_dof', first[1], 'a test')
    drawing, section = path.read_text().split('built:')
    assert old in section
    path.write_text(drawing + 'built:' + section.replace(old, new))
    with pytest.raises(ConfigError, match=message) as refused:
        load_machine(path)
    assert str(refused.value).startswith(str(path))


def test_calibrated_machine_file_reduces_positioning_errors(tmp_path):
    """The specimen of the plant is measured, calibrated, written to a file, and commanded with that file."""
    seed, path = 3, tmp_path / 'four_dof.yaml'
    used, _ = plant_specimen(seed)[1].split()
    write_calibrated_machine(path, 'four_dof', calibrated(FOUR_DOF, used), 'the plant')
    known = load_machine(path)
    wanted = FOUR_DOF.forward(study_poses(FOUR_DOF, 200, seed=7))

    def off(machine):
        specimen = Plant(machine, seed).truth.assembly  # the same specimen for both machines
        reached = specimen.end_point(machine.inverse(wanted) - specimen.encoder_offset, np.zeros((200, 0))) - wanted
        return (reached - reached.mean(axis=0)).std(axis=0)

    before, after = off(FOUR_DOF), off(known)
    assert (before[:3] > [2e-6, 4e-6, 0.8e-6]).all()
    assert (after < 0.15 * before).all()


@pytest.mark.parametrize('specimen', [Specimen.simulated('four_dof', 5, 'hard'), Specimen.measured('four_dof')])
def test_measurements_file_round_trips(specimen, tmp_path):
    _, seen = measured(FOUR_DOF, seed=5, poses=10)
    seen = seen._replace(specimen=specimen, deviation=np.array([0.1e-6, 0.2e-6, 0.3e-6, 1.5e-6]))
    write_measurements(tmp_path / 'laser.csv', FOUR_DOF, seen)
    again = read_measurements(tmp_path / 'laser.csv', FOUR_DOF)
    np.testing.assert_allclose(again.q, seen.q, atol=1e-12)
    np.testing.assert_allclose(again.displacement, seen.displacement, atol=1e-12)
    np.testing.assert_allclose(again.deviation, seen.deviation, atol=1e-12)
    assert again.specimen == specimen


def test_measurements_without_a_specimen_are_of_a_real_machine(tmp_path):
    write_measurements(tmp_path / 'laser.csv', FOUR_DOF, measured(FOUR_DOF, seed=5, poses=10)[1])
    again = read_measurements(tmp_path / 'laser.csv', FOUR_DOF)
    assert again.specimen == Specimen.measured('four_dof')
    assert again.deviation is None  # single readings


@pytest.mark.parametrize(
    ('remark', 'message'),
    [
        (
            '# specimen: planar, seed 1, environment hard',
            'planar, seed 1, environment hard; expected a specimen of four',
        ),
        ('# specimen: whatever', "line 1: specimen: 'whatever' given; expected 'MACHINE, seed N"),
        ('# deviation: 0.1, 0.1, 0.1', 'line 1: 3 deviations; expected 4'),
        ('# deviation: 0.1, 0.1, none, 0.1', 'line 1: could not convert'),
        ('# deviation: 0.1, 0.1, 0, 0.1', 'deviation .* allowed above 0'),
    ],
)
def test_bad_remark_of_measurements_is_refused(remark, message, tmp_path):
    path = tmp_path / 'laser.csv'
    write_measurements(path, FOUR_DOF, measured(FOUR_DOF, seed=5, poses=10)[1])
    path.write_text(f'{remark}\n{path.read_text()}')
    with pytest.raises(PkmError, match=message):
        read_measurements(path, FOUR_DOF)


@pytest.mark.parametrize(
    ('line', 'text', 'message'),
    [
        (0, 'd1,d3,d5,d7,x,y,z,phi', "heading 'd1,d3,d5,d7,x,y,z,phi'; expected d1_mm,d3_mm"),
        (2, '79.5,139.5,139.5,79.5,nan,0,0,0', r"line 3: x_um = 'nan'; expected a finite number"),
        (2, '79.5,139.5,139.5,79.5,0,0,0', 'line 3 has 7 cells; expected 8'),
        (2, '79.5,139.5,139.5,far,0,0,0,0', "d7_mm = 'far'"),
        (2, '179.5,139.5,139.5,79.5,0,0,0,0', r'heading: row 1: d1 = 179.5 mm; allowed 59.5 to 99.5 mm'),
    ],
)
def test_invalid_measurements_are_refused_by_line_and_cell(line, text, message, tmp_path):
    _, seen = measured(FOUR_DOF, seed=5, poses=10)
    path = tmp_path / 'laser.csv'
    write_measurements(path, FOUR_DOF, seen)
    lines = path.read_text().splitlines()
    lines[line] = text
    path.write_text('\n'.join(lines))
    with pytest.raises(PkmError, match=message):
        read_measurements(path, FOUR_DOF)
    with pytest.raises(PkmError, match='cannot be read'):
        read_measurements(tmp_path / 'none.csv', FOUR_DOF)


def test_too_few_or_non_finite_measurements_are_refused():
    _, seen = measured(FOUR_DOF, seed=5, poses=10)
    few = Measurements(seen.q[:4], seen.displacement[:4])
    with pytest.raises(PkmError, match='4 poses measured; 13 unknowns need at least 5'):
        calibrated(FOUR_DOF, few)
    broken = Measurements(seen.q, np.where(np.arange(10)[:, np.newaxis] == 3, np.nan, seen.displacement))
    with pytest.raises(PkmError, match='a displacement is not finite'):
        calibrated(FOUR_DOF, broken)


def test_misfit_of_errors_outside_the_model_is_refused():
    q = study_poses(FOUR_DOF, 60, seed=6)
    # a guide bent by 20 um over its length, which no length or mark describes
    bent = end_point(FOUR_DOF, q, {'d1': 20e-6 * np.sin((q[:, 0] - 0.0595) / 0.04 * 2.0 * np.pi)})
    seen = Measurements(q, bent - bent[0])
    noise = LASER.deviation(FOUR_DOF, q)
    assert calibrate(FOUR_DOF, seen, TOLERANCES, noise, largest_misfit=np.inf).misfit > 3.0
    with pytest.raises(
        PkmError, match=r'misfit \d.\d\d of the noise; allowed 1.5; residuals over the noise: x \d'
    ) as refused:
        calibrated(FOUR_DOF, seen)
    assert re.search(r'largest: pose \d+ (x|phi) [+-]\d+', str(refused.value))


def test_verification_names_the_coordinates_that_are_worse(first):
    _, found, held = first
    noise = LASER.deviation(FOUR_DOF, held.q)
    done = verify(FOUR_DOF, found.machine, held, noise)
    assert done.accepted
    assert done.better == FOUR_DOF.coordinates
    assert (done.after < 0.2 * done.before)[:2].all()
    back = verify(found.machine, FOUR_DOF, held, noise)
    assert not back.accepted
    assert set(back.worse) >= {'x', 'y', 'phi'}
    assert back.reasons(FOUR_DOF)[0].startswith(f'x: error at {len(held.q)} other poses ')
    # a repeated calibration that differs by the noise only is no reason to go back
    assert verify(found.machine, found.machine, held, noise).accepted


def test_verification_at_few_poses_is_refused(first):
    _, found, held = first
    with pytest.raises(PkmError, match='verification: 3 poses; allowed from 4'):
        verify(FOUR_DOF, found.machine, held.rows(slice(3)), LASER.deviation(FOUR_DOF, held.q))
