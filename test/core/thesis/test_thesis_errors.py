"""
Contradictions in the thesis, shown by numbers: one test per entry of docs/thesis.md that no other test covers.

Printed formulas are written out here as legible: minus signs are lost in the available text, plus signs are not.
"""

from pathlib import Path

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.design.objectives import objectives
from pkm_core.design.operational_workspace import load_operational_workspace
from pkm_core.machines import FourDof, load_machine
from pkm_core.thesis.gains import ROWS, printed_column
from pkm_core.thesis.results import END_POINT

FOUR_DOF, PLANAR = load_machine('four_dof'), load_machine('planar')
W = load_operational_workspace('chapter4')
MASSES, INERTIAS, GEOMETRY = FOUR_DOF.config.masses, FOUR_DOF.config.inertias, FOUR_DOF.config.geometry
PAGE = Path(__file__).parents[3] / 'docs' / 'thesis.md'


def random_joints(rows=2000):
    return np.random.default_rng(7).uniform(FOUR_DOF.limits.lower, FOUR_DOF.limits.upper, (rows, 4))


def test_signs_of_2_25_and_2_26_contradict_the_angle_of_2_19():
    """As printed."""
    q = random_joints()
    y, z, phi = FOUR_DOF.forward(q)[:, 1:].T
    y1 = GEOMETRY.dy + np.sqrt(GEOMETRY.l2**2 - (q[:, 1] - q[:, 0]) ** 2 / 4)
    lever = np.sqrt(GEOMETRY.k10**2 - (z - GEOMETRY.dz) ** 2) * np.sin(phi)
    np.testing.assert_allclose(y + lever, y1, atol=1e-12)
    assert np.abs(y - lever - y1).max() > 50e-3  # m


def test_links_10_and_12_lie_flat_in_any_direction_of_pq():
    """(3.28) requires x1 = x2; here PQ is at 45 degrees."""
    reach = 2 * GEOMETRY.k10 * (1 - 1e-9) / np.sqrt(2.0)
    height = np.sqrt(GEOMETRY.l2**2 - 0.03**2)
    x1, y2 = height + GEOMETRY.dx + reach, height + GEOMETRY.dy + reach
    q = np.array([x1 - 0.03, x1 + 0.03, y2 + 0.03, y2 - 0.03])
    assert FOUR_DOF.singularity_margin(q) < 1e-9
    assert np.abs(FOUR_DOF.jacobian(q)[2]).max() > 1e3


def test_row_of_d3_in_the_printed_mass_matrix_has_wrong_signs():
    half = 0.5 * (FOUR_DOF.home[1] - FOUR_DOF.home[0])
    a = MASSES.m2 * GEOMETRY.r2**2 + INERTIAS.I2 + MASSES.m4 * GEOMETRY.r4**2 + INERTIAS.I4
    a /= 4 * (GEOMETRY.l2**2 - half**2)
    across = (MASSES.m2 * GEOMETRY.r2 + MASSES.m4 * GEOMETRY.r4) / (2 * GEOMETRY.l2)
    own = MASSES.m4 * GEOMETRY.r4 / GEOMETRY.l2
    bare = PLANAR.config.model_copy(update={'masses': PLANAR.config.masses.model_copy(update={'mp': 0.0})})
    M = type(PLANAR)(bare, 'bare').mass_matrix(PLANAR.home)
    np.testing.assert_allclose(M[1], [across - a, MASSES.m3 + MASSES.m4 - own + a], rtol=1e-12)
    printed = np.array([-across + a, -(MASSES.m3 + MASSES.m4) + own - a])  # the signs of a and m4 r4/l are legible
    np.testing.assert_allclose(printed, -M[1], rtol=1e-12)


def test_block_between_p_and_q_as_printed_loses_mass():
    """With equal accelerations of P, Q and their loads the force must be that of the whole mass, in any direction."""
    m10, m12 = (m * r / (2 * GEOMETRY.k10) for m, r in ((MASSES.m10, GEOMETRY.r10), (MASSES.m12, GEOMETRY.r12)))
    own = MASSES.mp + MASSES.m9 + MASSES.m10 - m10 + MASSES.mq + MASSES.m11 + MASSES.m12 - m12
    whole = MASSES.mp + MASSES.m9 + MASSES.m10 + MASSES.mq + MASSES.m11 + MASSES.m12
    assert own + m10 + m12 == pytest.approx(whole)  # with the blocks m12 I and m10 I
    sine, cosine = np.sin(-np.pi / 4), np.cos(-np.pi / 4)
    assert own + (m10 + m12) * (sine**2 - cosine**2) == pytest.approx(whole - 0.0795, abs=1e-4)  # kg, at mid travel


def test_gravity_without_the_end_effector_is_15_percent_low():
    """G_v has the weights of links 10 and 12 only, and (5.21) only inertia."""
    light = FOUR_DOF.config.model_copy(update={'masses': MASSES.model_copy(update={'mef': 0.0})})
    share = FourDof(light, 'light').gravity(FOUR_DOF.home) / FOUR_DOF.gravity(FOUR_DOF.home)
    np.testing.assert_allclose(share, 0.855, atol=5e-4)


def test_initial_design_of_130_mm_has_other_objectives():
    """Than those printed, which belong to 150 mm."""
    printed = objectives(W.geometry(0.130, 0.130), W.workspace.poses_at_middle_angle(), 'thesis')
    assert (printed.f, printed.f1, printed.f2) == pytest.approx(
        (0.041, 8.47, 12.0), rel=0.01
    )  # 0.562, 153.125, 626.627


def test_objectives_decrease_below_the_shortest_link():
    """l = 70 mm, the optimum of Table 4.1, is an unstated bound."""
    for poses in (W.workspace.poses_at_middle_angle(), W.workspace.poses()):
        at = [
            np.array([min(getattr(objectives(W.geometry(l2, k), poses, 'thesis'), name) for k in LENGTHS) for l2 in L2])
            for name in ('f', 'f1', 'f2')
        ]
        for values in at:
            assert (np.diff(values) > 0.0).all()


L2 = (0.066, 0.068, 0.070, 0.072)
LENGTHS = np.arange(0.112, 0.124, 0.0005)


def test_printed_series_7_31_gives_twice_the_error_less_mean():
    samples = 40
    e, k = np.random.default_rng(1).standard_normal(samples), np.arange(samples)
    series = np.full(samples, e.mean())
    for n in range(1, samples):  # 1 .. N - 1
        wave = 2 * np.pi * n * k / samples
        R, I = (2 / samples * (e @ part(wave)) for part in (np.cos, np.sin))  # noqa: E741 - the thesis's symbols
        series += R * np.cos(wave) + I * np.sin(wave)
    np.testing.assert_allclose(series, 2 * e - e.mean(), atol=1e-12)


def test_gain_of_p3_as_printed_is_not_that_of_l3():
    gain = 1490.53 * 2.584e6 * 4.821e7 / (2.286e6 * 7.567e6)
    assert gain == pytest.approx(10734, abs=1)
    assert load_model(PLANAR)['d3'].gain == pytest.approx(10.797)  # m/s^2/V, (7.34)


def test_lowest_resonance_of_p3_is_below_410_hz_of_chapter_9():
    assert np.sqrt(2.286e6) / (2 * np.pi) == pytest.approx(240.6, abs=0.1)


def test_lag_with_the_measured_corner_has_another_phase():
    assert np.degrees(np.arctan(1000 / 7420)) == pytest.approx(7.68, abs=0.01)  # measured: 8.72
    assert 1000 / np.tan(np.radians(8.72)) == pytest.approx(6520, abs=5)  # Hz, corner with that phase


def test_identified_gains_imply_more_mass_than_table_6_1():
    listed = np.diagonal(FOUR_DOF.mass_matrix(FOUR_DOF.home))
    identified = FOUR_DOF.thrust_per_volt / np.array([model.gain for model in load_model(FOUR_DOF).values()])
    assert (listed.min(), listed.max()) == pytest.approx((0.818, 0.863), abs=1e-3)
    assert (identified.min(), identified.max()) == pytest.approx((1.257, 1.498), abs=1e-3)  # ch. 9: below 1 kg


def test_pole_and_zero_of_7_22_without_sample_time_vanish():
    for frequency in (302.0, 891.0):  # Table 7.1, d3
        assert np.exp(-2 * np.pi * frequency) == 0.0  # below the smallest number
    assert np.exp(-2 * np.pi * 302.0 * PLANAR.sample_time) == pytest.approx(0.387, abs=1e-3)


def test_printed_speed_feedforward_exceeds_the_printed_viscosity():
    """Kv/Ka per sample is a Ts in any units; the printed ratio is 6 to 89 times that, different on each axis."""
    factors = []
    for machine in (PLANAR, FOUR_DOF):
        for joint, model in load_model(machine).items():
            printed = dict(zip(ROWS, printed_column(machine.name, joint), strict=True))
            factors.append(printed['Kv'] / printed['Ka'] / (model.viscosity * machine.sample_time))
    assert (min(factors), max(factors)) == pytest.approx((6.1, 88.6), abs=0.1)


def test_robust_control_settles_later_than_stages_in_y_and_phi():
    settling = END_POINT['four_dof'].values['settling_5um_ms']
    later = [axis for axis, (stage, _, robust, _) in settling.items() if robust > stage]
    assert later == ['y', 'phi']


def test_every_error_of_the_page_names_its_test():
    section = PAGE.read_text(encoding='utf-8').partition('## Thesis errors found')[2].partition('\n## ')[0]
    rows = [line.strip('|').split('|') for line in section.splitlines() if line.startswith('|')][2:]
    assert len(rows) > 20
    for *_, shown in rows:
        assert shown.strip() == 'by reading' or shown.strip().startswith('`test_')
