"""Error budget: linear against Monte Carlo, ranking, same bits here and on a cluster, refusals."""

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.design.budget import deviation_from_datum, linear_budget, sources
from pkm_core.design.budget_monte_carlo import monte_carlo_budget, study_poses
from pkm_core.design.error_matrix import em_true, geometry_of, linkage
from pkm_core.design.specimen import end_point
from pkm_core.design.tolerances import LengthSpread, load_tolerances
from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine

FOUR_DOF, PLANAR = load_machine('four_dof'), load_machine('planar')
TOLERANCES = load_tolerances()
Q = study_poses(FOUR_DOF, 16, seed=1)


def only(**kept):
    """Return the tolerances with every spread zero but those named."""
    none = {'normal': 0.0}
    belts = {'stiffness': 100.0, 'torque': none}
    thermal = {'links_expand': 23.1e-6, 'links_warm': none, 'scales_expand': 8e-6, 'scales_warm': none}
    if 'scales_warm' in kept:
        thermal['scales_warm'] = kept.pop('scales_warm')
    spreads = {'links': none, 'offsets': none, 'encoder_offsets': none, 'belts': belts, 'thermal': thermal, **kept}
    return type(TOLERANCES)(**spreads)


def test_budget_of_links_alone_follows_the_error_matrix():
    budget = linear_budget(FOUR_DOF, only(links={'normal': 1e-6}), Q)
    E = em_true(linkage(geometry_of(FOUR_DOF), FOUR_DOF.forward(Q)))
    rounding = 0.1e-6 / np.sqrt(3.0) * FOUR_DOF.jacobian(Q)
    expected = np.sqrt(np.sum((1e-6 * E) ** 2, axis=-1) + np.sum(rounding**2, axis=-1))
    np.testing.assert_allclose(budget.total(), expected, rtol=1e-6)


def test_warm_scales_shift_sliders_in_proportion_to_position():
    budget = linear_budget(FOUR_DOF, only(scales_warm={'normal': 1.0}), Q)
    moved = np.einsum('pij,pj->pi', FOUR_DOF.jacobian(Q), 8e-6 * Q)
    scales = [source.name for source in budget.sources].index('scales warm')
    np.testing.assert_allclose(budget.deviations[scales], np.abs(moved), rtol=1e-6, atol=1e-12)


def test_simulated_deviation_equals_the_linear_one():
    found = monte_carlo_budget(FOUR_DOF, TOLERANCES, Q, 10_000, seed=1)
    linear = linear_budget(FOUR_DOF, TOLERANCES, Q).total()
    # 10 000 draws: standard error 0.7 %, second-order terms 1 % at a large Jacobian
    np.testing.assert_allclose(found.deviation, linear, rtol=0.035)
    assert (np.abs(found.mean) < 0.06 * linear).all()
    assert found.counts.sum(axis=0) == pytest.approx([10_000 * 16] * 4)


def test_quantiles_at_one_pose_are_those_of_a_normal():
    found = monte_carlo_budget(FOUR_DOF, TOLERANCES, FOUR_DOF.home[np.newaxis], 40_000, seed=1)
    for share, size, error in ((0.5, 0.6745, 0.01), (0.95, 1.96, 0.03), (0.997, 2.968, 0.1)):  # three standard errors
        np.testing.assert_allclose(found.quantile(share) / found.deviation[0], size, atol=error)


def test_ranking_puts_link_lengths_first_and_shares_add_up():
    budget = linear_budget(FOUR_DOF, TOLERANCES, Q)
    shares = budget.shares()
    assert next(iter(shares)) == 'link lengths'
    np.testing.assert_allclose(np.sum(list(shares.values()), axis=0), 1.0)
    sizes = [np.linalg.norm(row[:3]) for row in budget.source_deviations().values()]
    assert sizes == sorted(sizes, reverse=True)


def test_planar_machine_has_a_budget():
    q = study_poses(PLANAR, 4, seed=1)
    assert {source.name for source in sources(PLANAR, TOLERANCES, q)} >= {'l2', 'l4', 'dy', 'd1', 'd3', 'psi_p'}
    assert linear_budget(PLANAR, TOLERANCES, q).total().shape == (4, 2)


def test_same_seed_gives_the_same_bits():
    first, again, other = (monte_carlo_budget(FOUR_DOF, TOLERANCES, Q, 3000, seed=seed) for seed in (5, 5, 6))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first.mean, other.mean)


@pytest.mark.slow
def test_cluster_gives_the_same_bits():
    from distributed import LocalCluster

    here = monte_carlo_budget(FOUR_DOF, TOLERANCES, Q, 9000, seed=2)
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        there = monte_carlo_budget(FOUR_DOF, TOLERANCES, Q, 9000, seed=2, scheduler=cluster.scheduler_address)
    for a, b in zip(here, there, strict=True):
        np.testing.assert_array_equal(a, b)


def test_invalid_cluster_address_is_refused():
    with pytest.raises(PkmError, match="dask scheduler 'nobody': missing port"):
        monte_carlo_budget(FOUR_DOF, TOLERANCES, Q, 10, seed=1, scheduler='nobody')


def test_infeasible_study_is_refused():
    with pytest.raises(PkmError, match='links of a machine do not meet'):
        monte_carlo_budget(FOUR_DOF, only(links={'normal': 0.03}), Q, 1000, seed=1)
    with pytest.raises(PkmError, match='a xy_stage has no links'):
        linear_budget(load_machine('xy_stage'), TOLERANCES, Q[:, :2])


def test_uniform_spread_has_the_deviation_of_its_draws():
    spread = LengthSpread(uniform=3.0)
    drawn = spread.draw(np.random.default_rng(1), 100_000)
    assert np.abs(drawn).max() <= 3.0
    assert drawn.std() == pytest.approx(spread.deviation, rel=0.01)


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('links: {normal: 10 um}', 'links: {normal: -10 um}', 'links.normal'),
        (
            'links: {normal: 10 um}',
            'links: {normal: 10 um, uniform: 10 um}',
            'expected exactly one of normal and uniform',
        ),
        ('links: {normal: 10 um}', 'links: {normal: 10 K}', 'dimension'),
        ('stiffness: 100 N m/rad', 'stiffness: 0 N m/rad', 'belts.stiffness'),
        ('links: {normal: 10 um}', 'links: {normal: .inf um}', 'links.normal'),
    ],
)
def test_invalid_tolerances_are_refused(old, new, message, tmp_path):
    text = (Configuration.of_environment().folder / 'design' / 'tolerances.yaml').read_text()
    assert old in text
    path = tmp_path / 'mine.yaml'
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=message):
        load_tolerances(path)


def test_geometry_adds_its_sources_and_changes_no_other():
    budget, full = (linear_budget(FOUR_DOF, TOLERANCES, Q, geometry) for geometry in (False, True))
    np.testing.assert_array_equal(full.deviations[: len(budget.sources)], budget.deviations)
    added = {source.group for source in full.sources[len(budget.sources) :]}
    assert added == {'scales', 'straightness', 'squareness and height'}
    deviations = full.source_deviations()
    # a turn of Q about the crossing, which is 64 mm from it in x and 110 mm in y, moves the end point by half of that
    assert deviations['square'][0] == pytest.approx(50e-6 * 0.5 * 0.11, rel=0.1)
    simulated = monte_carlo_budget(FOUR_DOF, TOLERANCES, Q, 4000, seed=1, geometry=True)
    np.testing.assert_allclose(simulated.deviation, full.total(), rtol=0.05)  # 4000 draws: standard error 1.1 %


def test_deviation_from_the_datum_is_that_of_simulated_machines():
    """A laser from an unknown datum does not see what all poses have in common; most of the error of y is that."""
    links = [source for source in sources(FOUR_DOF, TOLERANCES, Q) if source.group == 'link lengths']
    draw = np.random.default_rng(1)
    errors = {source.name: 10e-6 * draw.standard_normal((4000, 1)) for source in links}
    off = end_point(FOUR_DOF, Q, errors) - FOUR_DOF.forward(Q)
    simulated = np.sqrt(np.mean((off - off.mean(axis=1, keepdims=True)) ** 2, axis=(0, 1)))
    np.testing.assert_allclose(deviation_from_datum(FOUR_DOF, links, Q), simulated, rtol=0.03)
    assert (simulated[:2] < 0.4 * np.sqrt(np.mean(off**2, axis=(0, 1)))[:2]).all()


def test_geometry_without_its_tolerances_is_refused():
    with pytest.raises(PkmError, match='tolerances: no section geometry'):
        linear_budget(PLANAR, only(), study_poses(PLANAR, 4, seed=1), geometry=True)
