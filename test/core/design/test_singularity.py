"""Singularity: intervals enclose, determinants agree with the Jacobian, the proof finds singular positions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pkm_core.design.interval import Interval
from pkm_core.design.singularity import bound_below, certificate, conditioning, regularity
from pkm_core.design.workspace import sample_joints
from pkm_core.errors import WorkspaceError
from pkm_core.machines import load_machine

FOUR_DOF, PLANAR, XY_STAGE = (load_machine(name) for name in ('four_dof', 'planar', 'xy_stage'))
every_machine = pytest.mark.parametrize('machine', [FOUR_DOF, PLANAR, XY_STAGE], ids=lambda machine: machine.name)
numbers = st.floats(-1e3, 1e3)


@given(numbers, numbers, numbers, numbers, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_intervals_enclose_the_results_of_their_members(a, b, c, d, s, t):
    x, y = Interval(min(a, b), max(a, b)), Interval(min(c, d), max(c, d))
    u = np.clip(x.lower + s * (x.upper - x.lower), x.lower, x.upper)
    v = np.clip(y.lower + t * (y.upper - y.lower), y.lower, y.upper)
    cases = [(x + y, u + v), (x - y, u - v), (x * y, u * v), (-x, -u), (2.0 - x, 2.0 - u)]
    if x.lower >= 0.0:
        cases.append((np.sqrt(x), np.sqrt(u)))
    if y.lower > 1e-3 or y.upper < -1e-3:
        cases.append((x / y, u / v))
    for interval, member in cases:
        assert interval.lower < member < interval.upper  # strictly: every operation rounds outwards


def test_intervals_refuse_undefined_operations():
    with pytest.raises(ZeroDivisionError):
        1.0 / Interval(-1.0, 1.0)
    with pytest.raises(ValueError, match='no square root'):
        np.sqrt(Interval(-2.0, -1.0))
    with pytest.raises(TypeError):
        np.sin(Interval(0.0, 1.0))


@every_machine
def test_closed_form_determinant_is_that_of_the_jacobian(machine):
    q = sample_joints(machine, 2000, seed=1)
    expected = np.abs(np.linalg.det(machine.jacobian(q)))
    np.testing.assert_allclose(regularity(machine, q.T)['abs(det J)'], expected, rtol=1e-12)


def test_determinant_of_the_four_dof_keeps_its_sign():
    """Value at home, range over the travel."""
    determinant = np.linalg.det(FOUR_DOF.jacobian(sample_joints(FOUR_DOF, 100_000, seed=1)))
    assert (determinant < 0.0).all()
    assert np.linalg.det(FOUR_DOF.jacobian(FOUR_DOF.home)) == pytest.approx(-1.236296937e-1, rel=1e-9)  # SI: 1/m
    assert determinant.min() > -0.587
    assert certificate(FOUR_DOF)['abs(det J)'].attained == pytest.approx(0.0114, abs=1e-4)


@every_machine
def test_certificate_bounds_every_sample_and_is_tight(machine):
    q = sample_joints(machine, 20_000, seed=2)
    values = regularity(machine, q.T)
    for name, bound in certificate(machine).items():
        assert 0.0 < bound.proven <= values[name].min()
        assert bound.proven >= (1.0 - 0.0101) * bound.attained  # asked for 1 %


def test_travel_with_a_singular_position_is_not_certified():
    def gap(q):  # of sliders that may collide
        return q[1] - q[0]

    with pytest.raises(WorkspaceError, match=r'falls to -0.02'):
        bound_below(gap, [0.0, 0.01], [0.03, 0.06])
    with pytest.raises(WorkspaceError, match='allowed above 0'):
        bound_below(lambda q: (q[0] - 0.3) * (q[0] - 0.3), [0.0], [1.0], most_boxes=1000)  # a zero inside the range


def test_conditioning_has_the_reference_range():
    axes = [np.linspace(*travel, 9) for travel in zip(FOUR_DOF.limits.lower, FOUR_DOF.limits.upper, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1)
    found = conditioning(FOUR_DOF, grid, 0.050)
    assert (found.min(), found.max()) == pytest.approx((3.9, 57.0), abs=0.5)  # two digits given
    assert conditioning(XY_STAGE, XY_STAGE.home, 0.050) == pytest.approx(1.0)
