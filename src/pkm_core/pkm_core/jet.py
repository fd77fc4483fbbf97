"""
Truncated Taylor series in time: evaluates a formula for position, velocity, acceleration and jerk at once.

A `Jet` takes the place of a NumPy array: ``machine.inverse(Jet.from_derivatives(p, v, a, j)).derivatives()`` is the
exact joint motion of a pose motion, without a hand-written derivative. Arithmetic, `np.sqrt`, `np.sin`, `np.cos` and
`np.arctan` are supported; any other NumPy function raises a TypeError for a Jet.
Source: Griewank & Walther, Evaluating Derivatives (2008), ch. 13 (recurrences of Taylor coefficients).
"""

from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

ORDER = 3  # jerk
_FACTORIALS = (1.0, 1.0, 2.0, 6.0)


class Jet(NDArrayOperatorsMixin):
    """
    Array-valued function of time, represented by its first Taylor coefficients.

    Attributes
    ----------
    coefficients : tuple of ORDER + 1 ndarrays of one shape
        ``coefficients[i]`` is the i-th time derivative over i! [unit / s^i].

    """

    def __init__(self, *coefficients):
        self.coefficients = tuple(np.broadcast_arrays(*coefficients))

    @classmethod
    def from_derivatives(cls, position, velocity, acceleration, jerk):
        """Return the Jet of a motion; shapes are broadcast."""
        motion = (position, velocity, acceleration, jerk)
        return cls(*(np.asarray(d) / f for d, f in zip(motion, _FACTORIALS, strict=True)))

    def derivatives(self):
        """Return (position, velocity, acceleration, jerk), each with the shape of the Jet."""
        return tuple(c * f for c, f in zip(self.coefficients, _FACTORIALS, strict=True))

    @property
    def value(self):
        """The position, an ndarray."""
        return self.coefficients[0]

    @property
    def shape(self):
        """Shape of the position and of each derivative."""
        return self.value.shape

    def __getitem__(self, index):
        return Jet(*(c[index] for c in self.coefficients))

    def __repr__(self):
        return f'Jet.from_derivatives{self.derivatives()}'

    def __array__(self, *args, **kwargs):
        raise TypeError('a Jet cannot be converted to an array; use .value or .derivatives()')

    def __array_ufunc__(self, ufunc, method, *inputs, **kwargs):
        rule = _RULES.get(ufunc)
        if rule is None or method != '__call__' or kwargs:
            return NotImplemented
        return Jet(*rule(*(_coefficients(x) for x in inputs)))


def value(x):
    """Return `x` without its derivatives: the position of a Jet, or the array itself."""
    return x.value if isinstance(x, Jet) else np.asarray(x, dtype=float)


def as_series(x):
    """Return `x` if it is a Jet, else as a float array; for formulas that accept both."""
    return x if isinstance(x, Jet) else np.asarray(x, dtype=float)


def stack(parts):
    """Return `parts` joined along a new last axis: an ndarray, or a Jet if any part is one."""
    if any(isinstance(part, Jet) for part in parts):
        series = [_coefficients(part) for part in parts]
        return Jet(*(np.stack(np.broadcast_arrays(*order), axis=-1) for order in zip(*series, strict=True)))
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _coefficients(x):
    return x.coefficients if isinstance(x, Jet) else (np.asarray(x), *([0.0] * ORDER))


def _multiply(a, b):
    return [sum(a[i] * b[n - i] for i in range(n + 1)) for n in range(ORDER + 1)]


def _divide(a, b):
    r = []
    for n in range(ORDER + 1):
        r.append((a[n] - sum(r[i] * b[n - i] for i in range(n))) / b[0])
    return r


def _sqrt(a):
    r = [np.sqrt(a[0])]
    for n in range(1, ORDER + 1):
        r.append((a[n] - sum(r[i] * r[n - i] for i in range(1, n))) / (2.0 * r[0]))
    return r


def _sin_cos(a):
    s, c = [np.sin(a[0])], [np.cos(a[0])]
    for n in range(1, ORDER + 1):  # s' = a' c and c' = -a' s
        s.append(sum(i * a[i] * c[n - i] for i in range(1, n + 1)) / n)
        c.append(-sum(i * a[i] * s[n - i] for i in range(1, n + 1)) / n)
    return s, c


def _arctan(a):
    r, g = [np.arctan(a[0])], _multiply(a, a)
    g[0] = 1.0 + g[0]
    for n in range(1, ORDER + 1):  # (1 + a^2) r' = a'
        r.append((a[n] - sum(i * r[i] * g[n - i] for i in range(1, n)) / n) / g[0])
    return r


_RULES: dict[Any, Any] = {
    np.add: lambda a, b: [x + y for x, y in zip(a, b, strict=True)],
    np.subtract: lambda a, b: [x - y for x, y in zip(a, b, strict=True)],
    np.negative: lambda a: [-x for x in a],
    np.multiply: _multiply,
    np.divide: _divide,
    np.sqrt: _sqrt,
    np.sin: lambda a: _sin_cos(a)[0],
    np.cos: lambda a: _sin_cos(a)[1],
    np.arctan: _arctan,
}
