"""The verbs of the design tools: what they print and write, and that a refusal is one line."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from pkm_core.design.pose_plan import spread_poses
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.simulation.true_rests import true_rests
from pkm_core.verbs import budget, calibrate, joint_forces, layouts, singularity, tolerance, workspace

RUN = CliRunner()


def call(verb, *options, folder=None):
    """Return (text, JSON) of `pkm VERB options`."""
    app = typer.Typer()
    app.command()(verb)
    if folder is not None:
        options = (*options, '--out', str(folder), '--json', str(folder / 'figures.json'))
    result = RUN.invoke(app, list(options), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output, json.loads((folder / 'figures.json').read_text()) if folder else None


def pictures(folder):
    return sorted(path.stem for path in folder.glob('*.png'))


def test_workspace_of_the_planar_machine_stands_beside_table_7_5(tmp_path):
    text, figures = call(workspace.workspace, '--machine', 'planar', '--samples', '20000', folder=tmp_path)
    assert '40 x 20.29 mm; Table 7.5: 40 x 21 mm' in text
    assert figures['volumes']['exact: integral of abs(det J)']['value'] == pytest.approx(392.0938, abs=1e-4)
    assert pictures(tmp_path) == ['workspace']


@pytest.mark.slow
def test_workspace_of_four_dof_draws_all_figures_and_surfaces(tmp_path):
    import trimesh

    _, figures = call(workspace.workspace, folder=tmp_path)
    assert pictures(tmp_path) == ['exact_boundary', *(f'fig_3_{number}' for number in range(1, 10))]
    assert figures['slices'] == 16
    assert figures['volumes']['exact: closed form']['value'] == pytest.approx(1330.0, abs=10.0)
    for name in ('contours', 'envelope'):
        for suffix in ('stl', 'ply'):
            assert trimesh.load_mesh(tmp_path / f'{name}.{suffix}').is_watertight


def test_singularity_tells_the_proof_and_draws_the_maps(tmp_path):
    text, figures = call(singularity.singularity, '--samples', '5000', folder=tmp_path)
    assert 'No singular position within the travel: proven with' in text
    assert 0.0 < figures['certificate']['abs(det J)']['proven'] < 0.0115
    assert pictures(tmp_path) == ['determinants', 'singularity_map']


@pytest.mark.slow
def test_tolerance_prints_the_thesis_beside_ours(tmp_path):
    text, figures = call(tolerance.tolerance, folder=tmp_path)
    for number in range(1, 6):
        assert f'Table 4.{number}' in text
    assert '626.627' in text
    assert len(figures['objectives']) == 12
    assert pictures(tmp_path) == ['fig_4_3', 'fig_4_4', 'fig_4_5', 'fig_4_6', 'fig_4_7', 'pareto']


def test_budget_ranks_the_sources(tmp_path):
    text, figures = call(budget.budget, '--machines', '2000', '--poses', '8', folder=tmp_path)
    assert '2000 machines at 8 poses' in text
    assert next(iter(figures['shares_of_variance'])) == 'link lengths'
    single, multi = (
        figures['joint_clearance'][f'{kind} um: deviation'] for kind in ('single-DOF, 1', 'multi-DOF, 100')
    )
    assert multi['x_um'] == pytest.approx(100.0 * single['x_um'])
    assert single['x_um'] == pytest.approx(1.0, rel=0.2)  # the accuracy that the thesis aims at
    assert pictures(tmp_path) == ['budget_contributions', 'budget_distribution', 'budget_map']


def test_layouts_compares_machines_and_draws_them(tmp_path):
    names = ('--machine', 'planar', '--machine', 'h_linkage', '--samples', '2000')
    text, figures = call(layouts.layouts, *names, folder=tmp_path)
    assert 'triangular' in text
    assert figures['machines']['planar']['workspace_mm2'] == pytest.approx(392.0938, abs=1e-4)
    assert list(figures['machines']) == ['planar', 'h_linkage']
    assert pictures(tmp_path) == ['layouts']


def test_joint_forces_prints_peaks_checks_and_a_figure(tmp_path):
    text, figures = call(joint_forces.joint_forces, '--machine', 'planar', folder=tmp_path)
    assert 'd1 - link 2' in text
    assert figures['motion'] == 'planar_80ms'
    assert max(figures['checks'][key] for key in ('residual_N', 'thrust_error_N', 'reaction_power_W')) < 1e-9
    row = figures['joints']['guide d1']
    assert 0.0 < row['along_rms_N'] < row['along_peak_N']
    assert pictures(tmp_path) == ['joint_forces']


def test_calibrate_reads_the_measurements_of_a_simulation(tmp_path):
    _, simulated = call(calibrate.calibrate, folder=tmp_path)
    again = tmp_path / 'again'
    again.mkdir()
    _, figures = call(calibrate.calibrate, '--measurements', str(tmp_path / 'measurements.csv'), folder=again)
    for title in ('drawing', 'calibrated'):
        assert figures['errors'][title] == pytest.approx(simulated['errors'][title], rel=1e-3)
    assert figures['errors']['calibrated']['x_um'] < 0.2 * figures['errors']['drawing']['x_um']
    assert figures['errors']['calibrated machine file'] == pytest.approx(figures['errors']['calibrated'], rel=1e-3)
    machine = load_machine(again / 'calibrated' / 'four_dof.yaml')
    assert machine.config.built.l4 != 0.07
    assert pictures(again) == ['calibration']
    assert figures['specimen'] == simulated['specimen'] == str(machine.specimen)
    # the recipe of docs/design.md ends with `pkm run` of this file: its tool is in place in the cell of the same seed
    drawing, poses = load_machine('four_dof'), spread_poses(machine, 8, 3)
    before, after = (true_rests(each, poses, seed=1, environment='nominal') - poses for each in (drawing, machine))
    before, after = (errors - errors.mean(axis=0) for errors in (before, after))
    assert (np.abs(before)[:, :2].max(axis=0) > 3e-6).all()
    assert (np.abs(after)[:, :3].max(axis=0) < 0.3e-6).all()
    with pytest.raises(PkmError, match=r'of specimen four_dof, seed 1, environment nominal; .* four_dof, seed 2'):
        true_rests(machine, poses, seed=2)


@pytest.mark.parametrize(
    ('verb', 'options', 'message'),
    [
        (workspace.workspace, ['--orientation', '-10', '--samples', '1000'], 'empty workspace'),
        (workspace.workspace, ['--dexterous', '-43', '-47', '--samples', '1000'], 'inverted'),
        (workspace.workspace, ['--cell', '0', '--samples', '1000'], 'cell 0 mm; allowed above 0 mm'),
        (tolerance.tolerance, ['--machine', 'planar'], 'the error matrix is that of a four_dof'),
        (tolerance.tolerance, ['--workspace', 'nowhere'], "'nowhere' is unknown"),
        (budget.budget, ['--machine', 'xy_stage'], 'has no links'),
        (budget.budget, ['--cluster', 'nobody', '--machines', '10'], "dask scheduler 'nobody'"),
        (calibrate.calibrate, ['--measurements', 'none.csv'], 'cannot be read'),
        (
            workspace.workspace,
            ['--machine', 'parallel_layout', '--samples', '1000'],
            'pkm layouts prints the workspace',
        ),
        (singularity.singularity, ['--machine', 'v_linkage', '--samples', '1000'], 'no proof for a linkage'),
        (layouts.layouts, ['--machine', 'xy_stage'], 'xy_stage has no links'),
        (joint_forces.joint_forces, ['--machine', 'h_linkage'], 'has kinematics only'),
        (joint_forces.joint_forces, ['--motion', 'planar_80ms'], 'motion is for planar; the machine is four_dof'),
    ],
)
def test_refusals_name_what_is_wrong(verb, options, message):
    with pytest.raises(PkmError, match=message):
        call(verb, *options)


@pytest.mark.parametrize(
    ('verb', 'options'),
    [(tolerance.tolerance, ['--arm', 'inf']), (workspace.workspace, ['--dexterous', '-47', 'nan'])],
)
def test_options_that_are_not_finite_are_refused(verb, options):
    app = typer.Typer()
    app.command()(verb)
    result = RUN.invoke(app, options)
    assert result.exit_code == 2
    assert 'expected finite numbers' in ' '.join(result.output.replace('│', ' ').split())
