"""Initial modes of H from a measured response alone, by a linear fit of a rational function."""

import numpy as np

_ROUNDS = 20
_LARGEST_DAMPING = 0.5  # of an initial mode


def guess_modes(frequency, response, deviation, count):
    """
    Return (gain, modes (count, 4)) of gain * H(j 2 pi f) close to `response` (F,) at `frequency` (F,) [Hz].

    Numerator and denominator, both of degree 2 `count`, come from a weighted linear fit. It is repeated with the last
    denominator in the weight (Sanathanan and Koerner, 1963). Unstable poles are reflected.
    """
    centre = np.sqrt(frequency[0] * frequency[-1])
    powers = (1j * frequency / centre)[:, np.newaxis] ** np.arange(2 * count + 1)
    columns = np.column_stack([powers, -response[:, np.newaxis] * powers[:, 1:]])
    denominator = np.ones(frequency.size)
    for _ in range(_ROUNDS):
        weight = 1 / (deviation * np.abs(denominator))
        weighted, target = weight[:, np.newaxis] * columns, weight * response
        size = np.linalg.norm(weighted, axis=0)
        solution, *_ = np.linalg.lstsq(
            np.vstack([weighted.real, weighted.imag]) / size, np.concatenate([target.real, target.imag]), rcond=None
        )
        solution = solution / size
        numerator, tail = solution[: 2 * count + 1], solution[2 * count + 1 :]
        denominator = powers @ np.append(1.0, tail)
    poles, zeros = (_pairs(np.roots(each[::-1]), count) for each in (np.append(1.0, tail), numerator))
    poles[:, 1] = np.abs(poles[:, 1])
    poles[:, 0], zeros[:, 0] = centre * poles[:, 0], centre * zeros[:, 0]
    return abs(numerator[0]), np.column_stack([poles, zeros])


def _pairs(roots, count):
    """Return (frequency, damping) of `count` second-degree factors with these `roots`; two real roots form a pair."""
    complex_ones = roots[roots.imag > 1e-9 * np.abs(roots)]
    real_ones = np.sort(roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots)].real)
    factors = [(abs(root), -root.real / abs(root)) for root in complex_ones]
    for first, second in zip(real_ones[::2], real_ones[1::2], strict=False):
        size = np.sqrt(abs(first * second))
        factors.append((size, -0.5 * (first + second) / size))
    rows = np.array(sorted(factors)[:count]).reshape(-1, 2)
    missing = count - len(rows)  # a leading coefficient of zero lowers the degree: put the root far above the band
    rows = np.vstack([rows, np.tile([10.0, 0.1], (missing, 1))])
    rows[:, 1] = np.clip(rows[:, 1], -_LARGEST_DAMPING, _LARGEST_DAMPING)
    rows[:, 1] = np.where(np.abs(rows[:, 1]) < 1e-3, 1e-3, rows[:, 1])
    return rows
