"""
Mean of rounded readings of a value at rest, and its uncertainty.

A reading is the nearest whole multiple of the step D to x + n, with normal noise n of deviation s. Its mean is
m(x) = x + b(x): with s = 0.2 D the bias b is up to 0.15 D and does not vanish by averaging. The rounding is undone by
solving m(x) = mean. The noise s is the one under which the readings of all rests are most probable; a prior keeps it
near the stated noise of the instrument where readings do not determine it.
"""

import numpy as np
from scipy.special import ndtr

_REACH = 8  # steps on both sides of the value that are summed
_NOISES = np.geomspace(0.05, 1.5, 40)  # [steps] least: rounding hides the value; largest: it has no effect
_PRIOR = np.log(1.5)  # deviation of the logarithm of the noise; chosen: an instrument's stated noise is that close
_TABLE = np.linspace(-0.75, 0.75, 301)  # [steps] of x from the nearest step
_RARE = 1e-12  # probability of a reading that this model excludes


def mean_at_rest(groups, step, noise):
    """
    Return the values (N,) behind groups of rounded readings, and the standard deviation of one such value.

    Parameters
    ----------
    groups : list of ndarray
        Readings of each rest, whole multiples of `step` from any datum.
    step : float
        Of the rounding; 0: the readings are not rounded.
    noise : float
        Stated noise of a reading before rounding; a first guess.

    Examples
    --------
    >>> draw = np.random.default_rng(1)
    >>> at = draw.uniform(-5.0, 5.0, 200)
    >>> groups = [np.round(x + 0.22 * draw.standard_normal(100)) for x in at]
    >>> found, deviation = mean_at_rest(groups, 1.0, 0.3)
    >>> plain = np.array([group.mean() for group in groups])
    >>> [round(float(np.std(each - at)), 3) for each in (found, plain)], round(deviation, 3)
    ([0.038, 0.093], 0.039)

    """
    means, sizes = (np.array([measure(group) for group in groups]) for measure in (np.mean, len))
    variances = np.array([np.var(group, ddof=1) for group in groups])
    plain = means, float(np.sqrt(np.mean(variances / sizes)))
    if not step > 0.0 or np.mean(variances) > (_NOISES[-1] * step) ** 2:
        return plain
    if variances.max() < (1e-6 * step) ** 2:  # nothing shows where between two roundings the value is
        return means, step / np.sqrt(12.0)
    nearest = np.round(means / step)
    counts = np.array([
        np.bincount(np.clip(np.round(group / step) - centre, -_REACH, _REACH).astype(int) + _REACH,
                    minlength=2 * _REACH + 1)
        for group, centre in zip(groups, nearest, strict=True)
    ])  # fmt: skip
    offsets = means / step - nearest
    best = max(_NOISES, key=lambda each: _likelihood(each, offsets, counts, max(noise / step, _NOISES[0])))
    if best == _NOISES[0]:
        return means, step / np.sqrt(12.0)
    level, _, _ = _moments(_TABLE, best)
    found = np.interp(offsets, level, _TABLE)
    _, spread, slope = _moments(np.concatenate([found, _TABLE[np.abs(_TABLE) <= 0.5]]), best)
    # of the values found and of a uniform one: few rests may all lie where rounding hides little
    expected = np.minimum(spread / np.mean(sizes) / slope**2, 1.0 / 12.0)
    variance = max(np.mean(expected[: len(found)]), np.mean(expected[len(found) :]))
    return step * (nearest + found), step * float(np.sqrt(variance))


def _likelihood(noise, offsets, counts, stated):
    """Return the log probability of `counts` (N, levels) at the values that `offsets` (N,) of the means imply."""
    level, _, _ = _moments(_TABLE, noise)
    share, _ = _shares(np.interp(offsets, level, _TABLE), noise)
    return np.sum(counts * np.log(np.maximum(share, _RARE))) - 0.5 * (np.log(noise / stated) / _PRIOR) ** 2


def _shares(x, noise):
    """Return the probabilities of the levels from -_REACH to _REACH at `x` (N,) [steps], and their slopes over x."""
    edges = (np.arange(-_REACH, _REACH + 2) - 0.5 - x[:, np.newaxis]) / noise
    density = np.exp(-0.5 * edges**2) / (np.sqrt(2.0 * np.pi) * noise)
    return np.diff(ndtr(edges), axis=1), -np.diff(density, axis=1)


def _moments(x, noise):
    """Return mean, variance and slope of the mean of readings at `x` [steps], three arrays like `x`."""
    share, growth = _shares(x, noise)
    steps = np.arange(-_REACH, _REACH + 1)
    level = share @ steps
    return level, share @ steps**2 - level**2, growth @ steps
