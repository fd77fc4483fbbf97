"""
Measurements of a calibration from recorded signals: encoders and laser averaged over rests.

Within a rest the laser's rounding is undone by the noise of its readings (quantisation.py). The stated deviation has
three parts: noise and rounding of the laser as found in the readings, noise of the averaged encoders, and the encoder
error that averaging does not reduce.
"""

import numpy as np

from pkm_core.design.measurement import Measurements, encoder_gains
from pkm_core.design.quantisation import mean_at_rest
from pkm_core.errors import PkmError

FEWEST_SAMPLES = 10  # of the laser or an encoder in a rest; chosen
MOST_MOTION = 20e-6  # [m] of an encoder within a rest; chosen: a standing axis moves by 2 um in the worst environment
_ON_STEP = 0.02  # [steps] from a multiple of the step; readings further off are not rounded to it


def rests_from_arrays(machine, time, q, laser_time, displacement, windows, laser, specimen=None):
    """
    Return the averaged `Measurements` of rests in recorded signals.

    Parameters
    ----------
    machine : Machine
        Its joints, coordinates and travel; its drawing or a calibrated machine.
    time, q : ndarray, shape (T,), (T, n)
        Instants [s] and encoder readings [m].
    laser_time, displacement : ndarray, shape (K,), (K, m)
        Instants [s] on the same clock, and displacements of the end point from one datum [m, rad].
    windows : array_like, shape (N, 2)
        Begin and end [s] of each average; the end is excluded.
    laser : LaserConfig
        Resolution of the laser, and the error of an encoder.
    specimen : Specimen, optional
        The measured machine.

    Raises
    ------
    PkmError
        If shapes disagree, stamps go back, a value in a rest is not finite, a rest has too few samples or is none, or
        the laser does not change over the poses. Pose and number are named.

    """
    time, q, laser_time, displacement = (np.asarray(part, float) for part in (time, q, laser_time, displacement))
    windows = np.asarray(windows, float).reshape(-1, 2)
    check_signal('encoders', time, q, machine.joints)
    check_signal('laser', laser_time, displacement, machine.coordinates)
    encoders = [_samples('encoders', k, time, q, window, machine.joints) for k, window in enumerate(windows)]
    seen = [
        _samples('laser', k, laser_time, displacement, window, machine.coordinates) for k, window in enumerate(windows)
    ]
    if not encoders:
        raise PkmError('rests: 0 given; expected at least one')
    for number, rest in enumerate(encoders):
        _check_standing(machine, number, rest)
    _check_alive(machine, seen)
    scale = laser.scale(machine)
    found = [
        _mean([rest[:, i] for rest in seen], factor * laser.resolution, factor * laser.noise)
        for i, factor in enumerate(scale)
    ]
    means, deviations = zip(*found, strict=True)
    positions = np.array([rest.mean(axis=0) for rest in encoders])
    averaged = np.mean([rest.var(axis=0, ddof=1) / len(rest) for rest in encoders])
    gains = encoder_gains(machine, positions)
    deviation = np.sqrt(np.square(deviations) + gains * (averaged + laser.encoder_error**2))
    machine.check_joints(positions)
    return Measurements(positions, np.stack(means, axis=1), deviation, specimen)


def joined(parts):
    """Return the `Measurements` of several recordings of one specimen with one datum."""
    first = parts[0]
    for part in parts[1:]:
        if part.specimen != first.specimen:
            raise PkmError(f'measurements: of {part.specimen} beside {first.specimen}; expected one specimen')
    weights = [len(part.q) for part in parts]
    return Measurements(
        np.concatenate([part.q for part in parts]),
        np.concatenate([part.displacement for part in parts]),
        np.sqrt(np.average([part.deviation**2 for part in parts], axis=0, weights=weights)),
        first.specimen,
    )


def _mean(groups, step, noise):
    """Return `mean_at_rest` with the rounding `step`, if the readings are multiples of it."""
    readings = np.concatenate(groups)
    rounded = step > 0.0 and np.abs(readings / step - np.round(readings / step)).max() <= _ON_STEP
    return mean_at_rest(groups, step if rounded else 0.0, noise)


def check_signal(what, time, values, names):
    """Refuse a signal whose shapes disagree or whose stamps are not finite or do not rise: `PkmError`."""
    if values.shape != (len(time), len(names)):
        raise PkmError(f'{what}: values of shape {values.shape}; expected ({len(time)}, {len(names)})')
    if not np.isfinite(time).all():
        raise PkmError(f'{what}: stamp {int(np.argmin(np.isfinite(time)))} is not finite')
    back = np.diff(time) <= 0.0
    if back.any():
        at = int(np.argmax(back))
        raise PkmError(f'{what}: stamp {at + 1} is {time[at + 1]:.6f} s after {time[at]:.6f} s; expected rising stamps')


def _samples(what, number, time, values, window, names):
    """Return the rows of `values` in `window`, the average of pose `number`."""
    begin, end = np.searchsorted(time, window - 1e-9)  # [s] rounding of products of a sample time
    where = f'pose {number}: {what} from {window[0]:.4f} to {window[1]:.4f} s'
    if end - begin < FEWEST_SAMPLES:
        raise PkmError(f'{where}: {end - begin} samples; expected at least {FEWEST_SAMPLES}')
    rows = values[begin:end]
    if not np.isfinite(rows).all():
        row, column = np.argwhere(~np.isfinite(rows))[0]
        came = rows[row, column]
        raise PkmError(f'{where}: {names[column]} is {came} at {time[begin + row]:.4f} s; expected a finite number')
    return rows


def _check_standing(machine, number, rest):
    span = np.ptp(rest, axis=0)
    if not (span <= MOST_MOTION).all():
        worst = int(np.argmax(span))
        raise PkmError(
            f'pose {number}: {machine.joints[worst]} moves by {1e6 * span[worst]:.1f} um during the average; allowed '
            f'{1e6 * MOST_MOTION:g} um'
        )


def _check_alive(machine, seen):
    """Refuse a laser that gives one value in all rests."""
    silent = [i for i in range(len(machine.coordinates)) if len(seen) > 1 and np.ptp(np.concatenate(seen)[:, i]) == 0.0]
    if silent:
        named = ', '.join(machine.coordinates[i] for i in silent)
        raise PkmError(f'laser: {named} has one value in all {len(seen)} rests; expected a laser that measures')
