"""Rests in bags as measurements of a calibration: of a cycle of this cell, or of another recorder by topics."""

import json
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.signals import read_signals
from pkm_core.design.calibration_motion import AVERAGED, windows_of_moves
from pkm_core.design.rests import check_signal, rests_from_arrays
from pkm_core.errors import PkmError
from pkm_core.machines.checks import ANGLES
from pkm_core.machines.identity import Specimen
from pkm_core.quantities import QuantityError, scale

STANDING = 5e-6  # [m] range of every encoder within a rest; chosen: twice that of a standing axis
GUARD = 0.02  # [s] between the average and the next move, whose first micrometres look like a rest; chosen


def rests_from_bag(bag, machine, laser, *, namespace=None, averaged=AVERAGED):
    """
    Return the averaged `Measurements` of the rests in a bag of this cell: any cycle with a laser.

    The rest after each move counts, except that after the return home. Encoder readings and laser are averaged over the
    last `averaged` [s] of a rest, or over the whole rest if it is shorter.

    Parameters
    ----------
    bag : Path
        Folder of the bag.
    machine : Machine
        Of the recorded cell; its drawing or a calibrated machine.
    laser : LaserConfig
        Resolution of the laser, and the error of an encoder.
    namespace : str, optional
        Of the cell; by default that of the only cell in the bag.
    averaged : float
        [s]

    Raises
    ------
    BagError
        If `bag` is no bag of a cell, or ticks are missing.
    PkmError
        If it is of another machine, not complete, or a rest is refused (`rests_from_arrays`); the bag is named.

    """
    record, name = read_cycle(bag, namespace), Path(bag).name
    if record.joints != machine.joints or record.coordinates != machine.coordinates:
        raise PkmError(f'{name}: of a machine with joints {list(record.joints)}; expected those of {machine.name}, '
                       f'{list(machine.joints)}')  # fmt: skip
    if not record.is_whole:
        raise PkmError(f'{name}: holds {len(record.ticks)} of {record.samples} ticks; expected a complete cycle')
    windows = record.sample_time * windows_of_moves(record.move_starts, record.move_ends, averaged / record.sample_time)
    time = record.sample_time * (record.ticks - record.ticks[0])
    try:
        return rests_from_arrays(
            machine,
            time,
            record.position,
            record.laser_time,
            record.laser,
            windows,
            laser,
            specimen_of(record, machine),
        )
    except PkmError as error:
        raise PkmError(f'{name}: {error}') from None


def specimen_of(record, machine):
    """
    Return the `Specimen` that a `CycleRecord` was recorded on.

    A simulated machine has recorded its seed and environment; a machine without them is a real one. `PkmError` if the
    bag is of another machine than `machine`.
    """
    recorded = Path(record.facts.get('machine', machine.name)).stem
    if recorded != machine.name:
        raise PkmError(f'recorded on {recorded}; expected {machine.name}')
    node = (json.loads(record.facts.get('parameters') or '{}') or {}).get('machine') or {}
    if 'seed' not in node or 'environment' not in node:
        return Specimen.measured(machine.name)
    return Specimen.simulated(machine.name, node['seed'], node['environment'])


def rests_from_signals(bag, machine, laser, encoders, displacements, *, rest, averaged=AVERAGED):
    """
    Return the averaged `Measurements` of the rests in a bag of another recorder, of a real machine.

    A rest is a time of at least `rest` [s] in which every encoder stays within STANDING. The average ends GUARD before
    its end.

    Parameters
    ----------
    bag : Path
        Any bag that rosbags reads.
    machine : Machine
        Of the bag; its drawing or a calibrated machine.
    laser : LaserConfig
        Resolution of the laser, and the error of an encoder.
    encoders : sequence of Signal
        One per joint, lengths.
    displacements : sequence of Signal
        One per coordinate, lengths and angles.
    rest, averaged : float
        Least duration of a rest, and that of the average [s].

    Raises
    ------
    BagError
        If the bag cannot be read, or lacks a topic or field.
    PkmError
        If a unit does not fit, stamps go back, there is no rest, or a rest is refused (`rests_from_arrays`).

    """
    if not rest >= averaged + GUARD:
        raise PkmError(f'rest of {rest:g} s; allowed from {averaged + GUARD:g} s, the average and {GUARD:g} s')
    read = read_signals(
        bag, dict(zip((*machine.joints, *machine.coordinates), (*encoders, *displacements), strict=True))
    )
    try:
        time, q = _together(read, machine.joints, encoders)
        laser_time, seen = _together(read, machine.coordinates, displacements)
        windows = find_rests(time, q, rest, averaged)
        return rests_from_arrays(machine, time, q, laser_time, seen, windows, laser, Specimen.measured(machine.name))
    except PkmError as error:
        raise PkmError(f'{Path(bag).name}: {error}') from None


def find_rests(time, q, rest, averaged):
    """
    Return the windows (N, 2) [s] of the averages in the rests of `q` (T, n) [m] at `time` (T,) [s].

    `PkmError` if there is no rest of at least `rest` [s].
    """
    size = max(2, round(rest / float(np.median(np.diff(time)))))
    span = maximum_filter1d(q, size, axis=0) - minimum_filter1d(q, size, axis=0)
    standing = np.concatenate([[False], (span <= STANDING).all(axis=1), [False]])
    edges = np.flatnonzero(np.diff(standing.astype(int)))
    windows = []
    for begin, end in edges.reshape(-1, 2):
        last = time[min(end - 1 + size // 2, len(time) - 1)] - GUARD
        if last - averaged >= time[max(begin - size // 2, 0)]:
            windows.append((last - averaged, last))
    if not windows:
        raise PkmError(f'no rest of {rest:g} s in {time[-1] - time[0]:g} s; a rest has all encoders within '
                       f'{1e6 * STANDING:g} um')  # fmt: skip
    return np.array(windows)


def _together(read, names, signals):
    """Return the times (T,) of the first of `signals` and the values (T, k) of all [SI], interpolated if necessary."""
    time = read[names[0]][0]
    columns = []
    for name, signal in zip(names, signals, strict=True):
        times, values = read[name]
        check_signal(signal.topic, times, values[:, np.newaxis], (name,))
        same = len(times) == len(time) and np.array_equal(times, time)
        values = _factor(name, signal) * values
        columns.append(values if same else np.interp(time, times, values))
    return time, np.stack(columns, axis=1)


def _factor(name, signal):
    """Return the factor to SI of a signal, whose dimension must be that of the coordinate or joint `name`."""
    try:
        factor, dimension = scale(signal.unit)
        expected = scale('rad' if name in ANGLES else 'm')[1]
    except QuantityError as error:
        raise PkmError(f'{name}: {error}') from None
    if dimension != expected:
        raise PkmError(f'{name}: unit {signal.unit!r}; expected a unit of {"angle" if name in ANGLES else "length"}')
    return factor
