"""Identification of a simulated machine: fits, model file, figures and the verb `pkm identify`."""

import json
from functools import cache

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from pkm_core.config import read_yaml
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import JointRecord
from pkm_core.identification.coupling import coupling_factor
from pkm_core.identification.excitation import experiments
from pkm_core.identification.figures import draw_identification
from pkm_core.identification.identify import identify_joint
from pkm_core.identification.model_file import write_model
from pkm_core.identification.partial_fractions import mode_rows
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.truth import load_truth
from pkm_core.simulation.cycles import run_cycles
from pkm_core.simulation.experiment import SimulatedCell
from pkm_core.verbs.identify import identify

BAND = (80.0, 500.0)


@cache
def parts(name):
    machine = load_machine(name)
    return machine, load_model(machine), load_control(machine)


@cache
def records(name, joint, seed=1):
    machine, models, gains = parts(name)
    cell = SimulatedCell(machine, gains, seed)
    return [cell.run(experiment) for experiment in experiments(machine, joint, models, gains)]


@cache
def found(name='planar', joint='d1'):
    machine, models, gains = parts(name)
    return identify_joint(machine, joint, records(name, joint), models, gains, band=BAND)


def truth(name, joint):
    """Return the true gain, viscosity and modes (m, 4)."""
    axis = load_truth(parts(name)[0], 'nominal')[0].axes[joint]
    return axis.gain * (1 + axis.gain_error), axis.viscosity * (1 + axis.viscosity_error), mode_rows(axis.modes)


def test_axis_is_recovered():
    gain, viscosity, modes = truth('planar', 'd1')
    axis = found()
    assert axis.low.gain == pytest.approx(gain, rel=0.01)  # 0.1 % seen; thrust varies by 1.5 % along the magnets
    assert axis.low.viscosity == pytest.approx(viscosity, rel=0.02)
    np.testing.assert_allclose(axis.high.modes[:, [0, 2]], modes[:, [0, 2]], rtol=0.003)
    np.testing.assert_allclose(axis.high.modes[:, [1, 3]], modes[:, [1, 3]], rtol=0.03)
    assert axis.low.friction == pytest.approx(0.5 / 11.05, rel=0.1)  # N over N/V
    assert axis.low.fit_percent > 99.5
    assert axis.high_percent > 95.0
    assert axis.low.instrument
    assert all(response.instrument and response.periodic for response in axis.responses)
    assert not axis.warnings


def test_errors_lie_within_the_stated_uncertainty():
    gain, viscosity, modes = truth('planar', 'd1')
    axis = found()
    assert abs(axis.low.gain - gain) < 3 * axis.low.deviations[0]
    assert abs(axis.low.viscosity - viscosity) < 3 * axis.low.deviations[1]
    pulls = (axis.high.modes - modes) / axis.high.deviations
    assert np.abs(pulls).max() < 4.0


def test_result_does_not_depend_on_the_prior_model():
    """Prior gain off by 20 %, prior viscosity by 50 %."""
    machine, models, gains = parts('planar')
    wrong = {
        joint: model.model_copy(update={'gain': 1.2 * model.gain, 'viscosity': 0.5 * model.viscosity})
        for joint, model in models.items()
    }
    again = identify_joint(machine, 'd1', records('planar', 'd1'), wrong, gains, band=BAND)
    assert again.low.gain == pytest.approx(found().low.gain, rel=1e-4)
    np.testing.assert_allclose(again.high.modes, found().high.modes, rtol=5e-3)


def test_same_records_give_the_same_bits():
    machine, models, gains = parts('planar')
    again = identify_joint(machine, 'd1', records('planar', 'd1'), models, gains, band=BAND)
    assert again.low.gain == found().low.gain
    np.testing.assert_array_equal(again.high.modes, found().high.modes)


def test_coupling_lowers_the_effective_mass_of_an_axis():
    """Below the bandwidth of the other loops the factor is 1; above it, that of floating axes."""
    machine, models, gains = parts('four_dof')
    factor = coupling_factor(machine, 0, machine.home, np.array([1.0, 600.0]), models, gains)
    M = machine.mass_matrix(machine.home) + np.diag(
        machine.thrust_per_volt / np.array([models[joint].gain for joint in machine.joints])
        - np.diag(machine.mass_matrix(machine.home))
    )
    assert factor[0] == pytest.approx(1.0, abs=1e-4)  # the loops hold the others
    assert abs(factor[1]) == pytest.approx(M[0, 0] * np.linalg.inv(M)[0, 0], rel=1e-3)  # they float


@pytest.mark.parametrize('joint', ['d1', 'd3'])
def test_ordinary_cycles_give_gain_and_viscosity(joint):
    """All axes move in a learning run without an excitation."""
    machine, models, gains = parts('planar')
    trajectory = to_joints(machine, plan(machine, load_motion(default_motion(machine))))
    run = run_cycles(machine, trajectory, gains, make_law('fourier_pid', machine, gains), 6, seed=1)
    moves = tuple(zip(trajectory.move_starts.tolist(), trajectory.move_ends.tolist(), strict=True))
    cycles = [
        JointRecord(f'cycle {number}', trajectory.position, counts, voltage, moves=moves)
        for number, (counts, voltage) in enumerate(zip(run.counts, run.voltage, strict=True), 1)
    ]
    axis = identify_joint(machine, joint, cycles, models, gains)
    gain, viscosity, _ = truth('planar', joint)
    assert axis.low.gain == pytest.approx(gain, rel=0.03)  # one stretch of the travel: thrust varies by 1.5 % along it
    assert axis.low.viscosity == pytest.approx(viscosity, rel=0.1)  # without a sweep the delay of H is not known
    assert axis.high is None
    assert axis.model(7420.0).modes == ()


def test_model_file_loads_with_the_identified_values(tmp_path):
    machine, models, _ = parts('planar')
    path = tmp_path / 'model.yaml'
    written = write_model(path, machine, {'d1': found()}, models, 'a test')
    assert load_model(machine, path) == written
    assert written['d3'] == models['d3']
    assert written['d1'].gain == pytest.approx(found().low.gain, rel=1e-6)
    np.testing.assert_allclose(mode_rows(written['d1'].modes), found().high.modes, rtol=1e-5)
    for line in path.read_text().splitlines()[3:]:
        assert '#' in line or line.endswith(':'), line  # every value has its origin
    assert '# K +- ' in path.read_text()
    assert list(read_yaml(path)['joints']) == list(machine.joints)


def test_unwritable_model_file_is_refused(tmp_path):
    machine, models, _ = parts('planar')
    with pytest.raises(IdentificationError, match='No such file or directory'):
        write_model(tmp_path / 'nowhere' / 'model.yaml', machine, {'d1': found()}, models, 'a test')


def test_figures_are_numbered_as_in_the_thesis(tmp_path):
    draw_identification(tmp_path, parts('planar')[0], {'d1': found()})
    assert sorted(path.name for path in tmp_path.iterdir()) == ['fig_7_11_response_d1.png', 'fig_7_9_moves_d1.png']


def test_records_without_plain_moves_are_refused():
    machine, models, gains = parts('planar')
    with pytest.raises(IdentificationError, match='d1: no record with moves without excitation'):
        identify_joint(machine, 'd1', records('planar', 'd1')[1:], models, gains, band=BAND)


def test_verb_writes_model_figures_and_json(tmp_path):
    app = typer.Typer()
    app.command()(identify)
    options = ['--machine', 'planar', '--joint', 'd3', '--out', str(tmp_path), '--json', str(tmp_path / 'all.json')]
    result = CliRunner().invoke(app, options, catch_exceptions=False)
    assert result.exit_code == 0
    assert '10.4' in result.output  # K of d3 [m/s^2/V]
    assert 'lies outside the band' in result.output.replace('\n', ' ')  # P3's zeros at 1105 Hz
    figures = json.loads((tmp_path / 'all.json').read_text())
    assert figures['axes']['d3']['gain'] == pytest.approx(truth('planar', 'd3')[0], rel=0.02)
    assert len(figures['axes']['d3']['responses']) == 3
    machine, models, _ = parts('planar')
    assert load_model(machine, tmp_path / 'model.yaml')['d1'] == models['d1']
    assert (tmp_path / 'fig_7_12_response_d3.png').is_file()


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (['--band', '80', '1200'], '80 to 1200 Hz'),
        (['--joint', 'd9'], "'d9'"),
        (['--stroke', '50'], r'a stroke of 50\.0 mm leaves the travel'),
        (['--jog', '60'], r'a stroke of \d+\.\d mm leaves the travel'),
        (['--voltage', '-1'], r'voltage: -1\.0 V given'),
        (['--positions', '21'], 'positions: 21; allowed up to 20'),
        (['--environment', 'mars'], "'mars' is unknown"),
    ],
)
def test_verb_refuses_invalid_options(options, reason):
    app = typer.Typer()
    app.command()(identify)
    with pytest.raises(PkmError, match=reason):
        CliRunner().invoke(app, ['--machine', 'planar', *options], catch_exceptions=False)
