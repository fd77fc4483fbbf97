"""Open-loop force cases (5.22)-(5.25) against an independent integration, and the full model with belts."""

import csv

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from pkm_core.errors import PkmError
from pkm_core.experiments.open_loop import CASES, integrate, play
from pkm_core.experiments.open_loop_report import REFERENCE, difference_figures, figures, write_csv
from pkm_core.machines import load_machine
from pkm_core.verbs.open_loop import open_loop

FOUR_DOF = load_machine('four_dof')
# independent program and formulation, tolerances 1e-10: net and amplitude [mm], end-effector range [mm, deg], time [s]
EXPECTED = {
    'i_a': {
        'net': (18.821412633447935, 17.80303910053007, 20.689540866914655, 16.281655492728788),
        'amplitude': (1.4672544563347638, 1.5533135024314806, 1.5274505669724183, 1.494566010651068),
        'lowest': (91.3401768519728, 91.37219740856295, 119.9020582428944, -45.0),
        'highest': (99.98225360204613, 100.73508923580455, 123.74944143956495, -44.030131899577086),
        'leaves': 0.12650333001537517,
    },
    'i_b': {
        'net': (18.834601048225764, 17.867045282658523, 20.678428944157417, 16.295092897462155),
        'amplitude': (1.4691121044994283, 1.509681764447497, 1.528288718223076, 1.4844231620398822),
        'lowest': (91.3727766016838, 91.3727766016838, 119.89636663625257, -45.387394747598734),
        'highest': (100.00473151525247, 100.72976585606372, 123.74694520616839, -44.38748508901489),
        'leaves': 0.1271330479192128,
    },
    'ii_a': {
        'net': (10.67743924771979, -9.083430679468734, 11.634471138239917, -9.107354621023632),
        'amplitude': (0.8486475662090989, 0.8958007859171166, 0.8592085499174613, 0.8186127928685737),
        'lowest': (88.69761430503932, 91.37199510598485, 123.34327183640289, -45.0),
        'highest': (91.3727766016838, 93.90491704457776, 123.77818071271201, -38.02477891789159),
        'leaves': None,
    },
    'ii_b': {
        'net': (10.693254572028309, -9.075083999770897, 11.614709281930516, -9.079066021447503),
        'amplitude': (0.8500883849620622, 0.8785411099643734, 0.858807344607451, 0.8176647268212993),
        'lowest': (88.75574499423229, 91.3727766016838, 123.34350137963258, -45.00724975046351),
        'highest': (91.4242569356187, 93.90760898030554, 123.74694520616839, -38.0345563186761),
        'leaves': None,
    },
}


@pytest.mark.parametrize('name', CASES)
def test_rigid_machine_moves_as_in_the_independent_program(name):
    response, expected = integrate(FOUR_DOF, CASES[name]), EXPECTED[name]
    found = figures(FOUR_DOF, CASES[name], response)
    np.testing.assert_allclose(found['net_mm'], expected['net'], atol=1e-7)
    np.testing.assert_allclose(found['amplitude_mm'], expected['amplitude'], rtol=1e-3)  # of a fit over other samples
    pose = response.pose * [1e3, 1e3, 1e3, np.degrees(1.0)]
    # extremes lie between samples of 0.5 ms: 120 mm/s is reversed within 35 ms
    np.testing.assert_allclose(pose.min(axis=0), expected['lowest'], atol=1e-3)
    np.testing.assert_allclose(pose.max(axis=0), expected['highest'], atol=1e-3)
    # expected is the first of 2000 samples beyond the travel
    assert found['leaves_travel_s'] == (expected['leaves'] and pytest.approx(expected['leaves'], abs=7e-5))
    assert found['leaves_travel_joint'] == (expected['leaves'] and 'd5')


@pytest.mark.parametrize('name', CASES)
def test_printed_reference_is_that_of_the_independent_program(name):
    printed, expected = REFERENCE[name], EXPECTED[name]
    span = np.subtract(expected['highest'], expected['lowest'])
    for ours, theirs in (('net_mm', expected['net']), ('amplitude_mm', expected['amplitude']), ('span_mm_deg', span)):
        np.testing.assert_allclose(printed[ours], theirs, atol=0.0051)
    assert printed['leaves_travel_s'] == (expected['leaves'] and pytest.approx(expected['leaves'], abs=6e-5))


def test_belts_allow_under_0p03_deg_of_platform_rotation():
    """At rest the rotation is that by gravity; the carriages move as with rigid belts to 0.02 mm."""
    case = CASES['i_a']  # that of Fig. 5.11
    response = integrate(FOUR_DOF, case, belt_stiffness=100.0)
    belts = figures(FOUR_DOF, case, response)['belts']
    assert 0.005 < belts['largest_turn_deg'] < 0.03
    assert belts['turn_at_rest_deg'] < 0.002  # gravity alone
    assert belts['largest_shift_um'] == pytest.approx(1.49, abs=0.05)
    assert belts['shift_at_rest_um'] < 0.2
    rigid = figures(FOUR_DOF, case, integrate(FOUR_DOF, case))
    np.testing.assert_allclose(figures(FOUR_DOF, case, response)['net_mm'], rigid['net_mm'], atol=0.02)


def test_platform_rotation_is_inverse_to_belt_stiffness():
    case = CASES['ii_b']
    stiff, soft = (integrate(FOUR_DOF, case, belt_stiffness=kb).belts[100:200] for kb in (400.0, 100.0))
    assert np.abs(soft).max() / np.abs(stiff).max() == pytest.approx(4.0, rel=0.1)


def test_losses_slow_the_complete_machine():
    """Slides move less than 6 mm; the rotation of the belts is that of the model without losses."""
    case = CASES['i_a']
    response = play(FOUR_DOF, case, seed=1, environment='elastic')
    found = figures(FOUR_DOF, case, response)
    # 1.3 to 1.5 kg, not 0.85 kg; viscous friction of 15 to 41 /s reduces the drift
    assert (np.abs(found['net_mm']) < 6.0).all()
    assert ((found['amplitude_mm'] > 0.8) & (found['amplitude_mm'] < 1.1)).all()
    assert found['leaves_travel_s'] is None
    assert found['fault'] is None
    assert 0.003 < found['belts']['largest_turn_deg'] < 0.03
    np.testing.assert_array_equal(play(FOUR_DOF, case, 1, 'elastic').q, response.q)


def test_other_mechanisms_are_refused():
    with pytest.raises(PkmError, match='planar: a planar given'):
        integrate(load_machine('planar'), CASES['i_a'])


def test_csv_has_one_row_per_sample_and_units(tmp_path):
    response = integrate(FOUR_DOF, CASES['ii_a'])
    write_csv(tmp_path / 'case.csv', FOUR_DOF, response)
    rows = list(csv.DictReader((tmp_path / 'case.csv').open()))
    assert len(rows) == len(response.time)
    assert float(rows[-1]['d1_mm']) == pytest.approx(1e3 * response.q[-1, 0], rel=1e-8)
    assert float(rows[0]['phi_deg']) == pytest.approx(-45.0)
    assert float(rows[70]['force_d3_N']) == pytest.approx(response.force[70, 1], rel=1e-8)


def test_verb_writes_figures_and_csv(tmp_path):
    app = typer.Typer()
    app.command()(open_loop)
    done = CliRunner().invoke(app, ['--environment', 'ideal', '--out', str(tmp_path)], env={'COLUMNS': '100'})
    assert done.exit_code == 0, done.output
    assert '18.82 17.80 20.69 16.28' in done.output
    assert '126.5 ms d5' in done.output
    names = {path.name for path in tmp_path.iterdir()}
    assert {f'open_loop_{case}{end}.png' for case in CASES for end in ('', '_difference')} < names
    assert 'difference of the joints from the rigid model' in done.output
    assert {f'open_loop_{case}_{kind}.csv' for case in CASES for kind in ('rigid', 'ideal')} < names


def test_differences_from_the_rigid_model_are_those_of_the_belts():
    """Stiffer belts, smaller differences; samples at other times are compared at one time."""
    case = CASES['ii_b']
    rigid = integrate(FOUR_DOF, case)
    stiff, soft = (
        difference_figures(integrate(FOUR_DOF, case, belt_stiffness=kb), rigid)['largest_um'] for kb in (400.0, 100.0)
    )
    assert (soft < 0.2).all()
    assert (stiff < 0.5 * soft).all()
    assert (stiff > 1e-3).all()  # above the accuracy of integration and interpolation
    np.testing.assert_allclose(difference_figures(rigid, rigid)['largest_um'], 0.0, atol=1e-9)
