"""
Mean of rounded readings of a value at rest, and its uncertainty.

A reading is the nearest whole multiple of the step D to x + n, with normal noise n of deviation s. Its mean is
m(x) = x + b(x): with s = 0.2 D the bias b is up to 0.15 D and does not vanish by averaging. The rounding is undone by
solving m(x) = mean. The noise is taken from the readings: averaged over x, the variance of readings is
s^2 + D^2 / 12 - mean of b^2.
"""

import numpy as np
from scipy.special import ndtr

_REACH = 8  # steps on both sides of the value that are summed
_LEAST, _MOST = 0.05, 1.5  # [steps] of the noise; below, rounding hides the value; above, it has no effect


def mean_at_rest(groups, step):
    """
    Return the values (N,) behind groups of rounded readings, and the standard deviation of one such value.

    Parameters
    ----------
    groups : list of ndarray
        Readings of each rest, whole multiples of `step` from any datum.
    step : float
        Of the rounding; 0: the readings are not rounded.

    Examples
    --------
    >>> draw = np.random.default_rng(1)
    >>> at = draw.uniform(-5.0, 5.0, 200)
    >>> groups = [np.round(x + 0.22 * draw.standard_normal(100)) for x in at]
    >>> found, deviation = mean_at_rest(groups, 1.0)
    >>> plain = np.array([group.mean() for group in groups])
    >>> [round(float(np.std(each - at)), 3) for each in (found, plain)], round(deviation, 3)
    ([0.039, 0.093], 0.039)

    """
    means = np.array([group.mean() for group in groups])
    sizes = np.array([len(group) for group in groups])
    within = float(np.sum([np.sum((group - mean) ** 2) for group, mean in zip(groups, means, strict=True)]))
    variance = within / max(1, int(np.sum(sizes - 1)))
    if not step > 0.0:
        return means, float(np.sqrt(np.mean(variance / sizes)))
    noise = _noise(variance / step**2)
    if noise >= _MOST:
        return means, float(np.sqrt(np.mean(variance / sizes)))
    if noise <= _LEAST:
        return means, step / np.sqrt(12.0)
    nearest = np.round(means / step)
    table = np.linspace(-0.75, 0.75, 601)  # of x from the nearest step
    level, spread, slope = _moments(table, noise)
    found = nearest + np.interp(means / step - nearest, level, table)
    inside = np.abs(table) <= 0.5
    variances = np.minimum(spread[inside] / np.mean(sizes) / slope[inside] ** 2, 1.0 / 12.0)
    return step * found, step * float(np.sqrt(np.mean(variances)))


def _noise(variance):
    """Return the noise [steps] whose rounded readings have this mean `variance` within a rest [steps^2]."""
    noise = np.linspace(_LEAST, _MOST, 400)
    order = np.arange(1, 20)[:, np.newaxis]
    bias = np.sum(0.5 / (np.pi * order) ** 2 * np.exp(-((2.0 * np.pi * order * noise) ** 2)), axis=0)
    return float(np.interp(variance, noise**2 + 1.0 / 12.0 - bias, noise))


def _moments(x, noise):
    """Return mean, variance and slope of the mean of readings at `x` [steps], three arrays like `x`."""
    steps = np.arange(-_REACH, _REACH + 1)
    edges = (np.append(steps, _REACH + 1) - 0.5 - x[:, np.newaxis]) / noise
    below = ndtr(edges)
    density = np.exp(-0.5 * edges**2) / (np.sqrt(2.0 * np.pi) * noise)
    share, growth = np.diff(below, axis=1), -np.diff(density, axis=1)
    level = share @ steps
    return level, share @ steps**2 - level**2, growth @ steps
