"""Read identification records from bags: bags of this cell, and any other axis by topics, fields and units."""

from pathlib import Path

import numpy as np

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import read_topics
from pkm_core.bag.signals import read_signals
from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import AxisData, JointRecord
from pkm_core.quantities import QuantityError, scale

_SAME = 1e-3  # [sample times] closer stamps count as equal
_LARGEST_GAP = 10  # [median sample times] a longer gap is missing data, not jitter


def read_cell_bag(machine, path, namespace='/pkm'):
    """
    Return (JointRecord, warnings) of a bag of this cell.

    The topic ``excitation`` holds one message per excited joint: ``joint`` and ``voltage``, one value per tick.

    Raises
    ------
    BagError
        If `path` is not a bag of this cell, or has a gap.
    IdentificationError
        If the bag is empty, the machine or sample time differs, or the excitation does not fit the cycle.

    """
    cycle = read_cycle(path, namespace)
    name, samples = Path(path).name, len(cycle.ticks)
    if cycle.joints != machine.joints:
        raise IdentificationError(f'{name}: joints {list(cycle.joints)}; {machine.name} has {list(machine.joints)}')
    if abs(cycle.sample_time - machine.sample_time) > 1e-12:
        raise IdentificationError(
            f'{name}: sample time {1e3 * cycle.sample_time:g} ms; {machine.name} has {1e3 * machine.sample_time:g} ms'
        )
    if samples == 0:
        raise IdentificationError(f'{name}: 0 of {cycle.samples} ticks; at least 1 is needed')
    warnings = [] if cycle.is_whole else [f'{name}: holds {samples} of {cycle.samples} ticks; the rest is missing']
    moves = zip(cycle.move_starts.tolist(), cycle.move_ends.tolist(), strict=True)
    record = JointRecord(
        name=name,
        reference=cycle.reference,
        counts=cycle.counts,
        voltage=cycle.voltage,
        excitation=_excitation(machine, path, namespace, name, cycle.samples, samples),
        moves=tuple((start, end) for start, end in moves if end < samples),
    )
    return record, warnings


def _excitation(machine, path, namespace, name, whole, samples):
    """Return the excitation (samples, n) [V], or None if the bag has none."""
    messages = read_topics(path, [f'{namespace}/excitation'])[f'{namespace}/excitation']
    if not messages:
        return None
    volts = np.zeros((whole, len(machine.joints)))
    for message in messages:
        if message.joint not in machine.joints or len(message.voltage) != whole:
            raise IdentificationError(
                f'{name}: excitation of joint {message.joint!r} with {len(message.voltage)} samples; expected one of '
                f'{list(machine.joints)} with {whole}'
            )
        volts[:, machine.joints.index(message.joint)] = message.voltage
    return volts[:samples]


def read_axis(path, drive, sensor, *, reference=None, excitation=None, delay=0.0, limit=np.inf):
    """
    Return (AxisData, dead time beyond whole samples [s], warnings) of an axis from any bag.

    The time of a sample is its header stamp; without a header it is the time of reception. All signals are resampled
    at the median sample time of `sensor`. Positions are interpolated linearly; drive and excitation are held.

    Parameters
    ----------
    path : Path
        rosbag2 folder, MCAP file or ROS 1 bag.
    drive, sensor, reference, excitation : Signal
        Drive and position of the axis; if recorded, its reference and the excitation added to the drive.
    delay : float
        From the stamp of the drive to its effect [s].
    limit : float
        Limit of the drive, in the unit of `drive`.

    Raises
    ------
    BagError
        If `path` cannot be read, lacks a topic or field, or a signal has fewer than two messages.
    IdentificationError
        If a signal has a gap, or a unit does not fit.

    """
    given = {'drive': drive, 'sensor': sensor, 'reference': reference, 'excitation': excitation}
    signals = {name: signal for name, signal in given.items() if signal is not None}
    series = _read_series(path, signals)
    scales = {name: _scale(name, signal.unit) for name, signal in signals.items()}
    for name, partner in (('reference', 'sensor'), ('excitation', 'drive')):
        if name in scales and scales[name][1] != scales[partner][1]:
            raise IdentificationError(
                f'{name} in {signals[name].unit}, {partner} in {signals[partner].unit}; expected the same dimension'
            )
    begin = max(times[0] for times, _ in series.values())
    end = min(times[-1] for times, _ in series.values())
    steps = np.diff(series['sensor'][0])
    sample_time = float(np.median(steps))
    warnings = []
    for name, (times, _) in series.items():
        longest = np.diff(times).max()
        if longest > _LARGEST_GAP * sample_time:
            raise IdentificationError(
                f'{path}: {signals[name].topic} has a gap of {1e3 * longest:.1f} ms; allowed '
                f'{1e3 * _LARGEST_GAP * sample_time:.1f} ms, {_LARGEST_GAP} sample times'
            )
    jitter = float(np.std(steps)) / sample_time
    if jitter > 0.1:
        warnings.append(
            f'{path}: the sample time of {sensor.topic} is {1e3 * sample_time:.3f} ms +- {100 * jitter:.0f} %'
        )
    count = int((end - begin) / sample_time) + 1 if end > begin else 0
    grid = begin + sample_time * np.arange(count)
    even = {}
    for name, (times, values) in series.items():
        held = name in ('drive', 'excitation')
        last = np.searchsorted(times, grid + _SAME * sample_time, side='right') - 1
        at = values[last] if held else np.interp(grid, times, values)
        even[name] = scales[name][0] * at
    computation = int(delay / sample_time)
    data = AxisData(
        name=Path(path).name,
        sample_time=sample_time,
        voltage=even['drive'],
        position=even['sensor'],
        reference=even.get('reference'),
        excitation=even.get('excitation'),
        limit=limit * scales['drive'][0],
        computation=computation,
    )
    return data, delay - computation * sample_time, warnings


def _read_series(path, signals):
    """Return {name: (times [s], values)} for `signals`, in the order of time and without repeated stamps."""
    series = {}
    for name, (times, values) in read_signals(path, signals).items():
        order = np.lexsort((values, times))
        new = order[np.append(True, np.diff(times[order]) > 0)]
        series[name] = times[new], values[new]
    return series


def _scale(name, unit):
    """Return (factor to SI, dimension) of a unit."""
    try:
        return scale(unit)
    except QuantityError as error:
        raise IdentificationError(f'{name}: {error}') from None
