"""Truncated Taylor series compared with closed forms, differences and each other."""

import numpy as np
import pytest

from pkm_core.jet import Jet, as_series, stack, value


def series_at(function, t):
    """Return the Jet of a motion given as function(t) -> (position, velocity, acceleration, jerk)."""
    return Jet.from_derivatives(*function(t))


def polynomial(t):
    """1 + t + t^2 / 2 + t^3 / 5 and its derivatives."""
    return 1 + t + t**2 / 2 + t**3 / 5, 1 + t + 3 * t**2 / 5, 1 + 6 * t / 5, np.full_like(t, 6 / 5)


T = np.linspace(0.0, 1.0, 7)
X = series_at(polynomial, T)


def assert_derivatives(jet, *expected, tolerance=1e-12):
    for came, wanted in zip(jet.derivatives(), np.broadcast_arrays(*expected), strict=True):
        np.testing.assert_allclose(came, wanted, rtol=tolerance, atol=tolerance)


def test_derivatives_return_what_from_derivatives_took():
    assert_derivatives(X, *polynomial(T), tolerance=0.0)


def test_elementary_functions_of_time_give_their_derivatives():
    t = Jet.from_derivatives(T, 1.0, 0.0, 0.0)
    s, c = np.sin(T), np.cos(T)
    assert_derivatives(np.sin(t), s, c, -s, -c)
    assert_derivatives(np.cos(t), c, -s, -c, s)
    g = 1 + T**2
    assert_derivatives(np.arctan(t), np.arctan(T), 1 / g, -2 * T / g**2, (6 * T**2 - 2) / g**3)
    u = 1 + T
    assert_derivatives(np.sqrt(1 + t), u**0.5, 0.5 * u**-0.5, -0.25 * u**-1.5, 0.375 * u**-2.5)
    assert_derivatives(1 / (1 + t), 1 / u, -1 / u**2, 2 / u**3, -6 / u**4)


def test_product_follows_leibniz():
    p, v, a, j = polynomial(T)
    assert_derivatives(X * X, p * p, 2 * p * v, 2 * (v * v + p * a), 2 * (3 * v * a + p * j))


@pytest.mark.parametrize(
    ('left', 'right'),
    [
        (np.sqrt(X) * np.sqrt(X), X),
        (np.sin(X) * np.sin(X) + np.cos(X) * np.cos(X), 1.0 + 0.0 * X),
        ((X / (2.0 + np.cos(X))) * (2.0 + np.cos(X)), X),
        (np.arctan(np.sin(0.5 * X) / np.cos(0.5 * X)), 0.5 * X),
        (-(2.0 - X) + 2.0, X),
    ],
    ids=['sqrt', 'sin cos', 'divide', 'arctan', 'signs'],
)
def test_identities_hold_in_every_derivative(left, right):
    assert_derivatives(left, *right.derivatives())


def test_nested_formula_agrees_with_differences():
    def formula(x):
        return np.arctan(np.sqrt(1.0 + x * x) / (2.0 + np.sin(x)))

    h = 1e-3
    p = [formula(polynomial(T + i * h)[0]) for i in range(-2, 3)]
    differences = (
        p[2],
        (p[0] - 8 * p[1] + 8 * p[3] - p[4]) / (12 * h),
        (-p[0] + 16 * p[1] - 30 * p[2] + 16 * p[3] - p[4]) / (12 * h**2),
        (-p[0] + 2 * p[1] - 2 * p[3] + p[4]) / (2 * h**3),
    )
    # the jerk difference is the worst: truncation 0.25 h^2 times a fifth derivative of up to 100
    assert_derivatives(formula(X), *differences, tolerance=1e-4)


def test_arrays_and_jets_mix_and_broadcast():
    rows = np.arange(3.0)[:, None]
    for product in (rows * X, X * rows):
        assert isinstance(product, Jet)
        assert product.shape == (3, 7)
        np.testing.assert_array_equal(product[2].derivatives()[3], 2.0 * X.derivatives()[3])


def test_stack_joins_jets_and_constants_along_a_new_last_axis():
    both = stack([X, np.ones(7)])
    assert both.shape == (7, 2)
    assert_derivatives(both[..., 0], *X.derivatives())
    assert_derivatives(both[..., 1], np.ones(7), 0.0, 0.0, 0.0)
    np.testing.assert_array_equal(stack([T, 1.0]), np.column_stack([T, np.ones(7)]))


def test_value_and_as_series_take_both_kinds():
    assert as_series(X) is X
    np.testing.assert_array_equal(value(X), polynomial(T)[0])
    assert as_series([1, 2]).dtype == value([1, 2]).dtype == float


@pytest.mark.parametrize('function', [np.exp, np.asarray, lambda x: np.stack([x, x]), lambda x: x > 0.0, np.add.reduce])
def test_unsupported_function_is_refused(function):
    with pytest.raises(TypeError):
        function(X)
