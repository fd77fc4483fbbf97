"""
Interval arithmetic: an `Interval` replaces a NumPy array and encloses all values of a formula over boxes.

Each operation rounds its ends outwards by one floating-point number, so a bound holds for real numbers, not only for
the computation. Supported are +, -, *, / and `np.sqrt`; other NumPy functions raise a TypeError.
Source: Moore, Kearfott & Cloud, Introduction to Interval Analysis (2009), ch. 2 and 3.
"""

from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin


class Interval(NDArrayOperatorsMixin):
    """
    Array of closed intervals.

    Attributes
    ----------
    lower, upper : ndarray
        Ends, of one shape.

    Examples
    --------
    >>> x = Interval(1.0, 2.0)
    >>> (x * x - 3.0 * x).lower.round(9), (x * x - 3.0 * x).upper.round(9)
    (np.float64(-5.0), np.float64(1.0))

    """

    def __init__(self, lower, upper):
        self.lower, self.upper = np.broadcast_arrays(np.asarray(lower, dtype=float), np.asarray(upper, dtype=float))

    def __repr__(self):
        return f'Interval({self.lower}, {self.upper})'

    def __array_ufunc__(self, ufunc, method, *inputs, **kwargs):
        rule = _RULES.get(ufunc)
        if rule is None or method != '__call__' or kwargs:
            return NotImplemented
        lower, upper = rule(*(_ends(x) for x in inputs))
        return Interval(np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf))


def _ends(x):
    return (x.lower, x.upper) if isinstance(x, Interval) else (np.asarray(x, dtype=float),) * 2


def _multiply(a, b):
    products = np.stack(np.broadcast_arrays(*(x * y for x in a for y in b)))
    return products.min(axis=0), products.max(axis=0)


def _divide(a, b):
    if np.any((b[0] <= 0.0) & (b[1] >= 0.0)):
        raise ZeroDivisionError('division by an interval that contains 0')
    quotients = np.stack(np.broadcast_arrays(*(x / y for x in a for y in b)))
    return quotients.min(axis=0), quotients.max(axis=0)


def _sqrt(a):
    if np.any(a[1] < 0.0):
        raise ValueError('an interval below 0 has no square root')
    return np.sqrt(np.maximum(a[0], 0.0)), np.sqrt(a[1])  # of the part from 0


_RULES: dict[Any, Any] = {
    np.add: lambda a, b: (a[0] + b[0], a[1] + b[1]),
    np.subtract: lambda a, b: (a[0] - b[1], a[1] - b[0]),
    np.negative: lambda a: (-a[1], -a[0]),
    np.multiply: _multiply,
    np.divide: _divide,
    np.sqrt: _sqrt,
}
