"""
Signals of other people's bags as series over time.

Messages without the named number are skipped and counted. The time of a sample is its header stamp; without a header,
or if all stamps of the topic are 0, it is the time of reception. A clock that cannot place the samples is refused.
"""

from collections import defaultdict
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from pkm_core.bag.reader import opened, read_metadata, reason_of
from pkm_core.errors import BagError
from pkm_core.identification import IdentificationError

RECEPTION, STAMPS = 'time of reception', 'header stamps'
_LATE = 1.5  # [median steps] a message later than this is no reordering of neighbours: the clock has stepped back
_CONTRADICT = 0.01  # largest share of messages with the stamp of another message and another value


@dataclass(frozen=True)
class Signal:
    """Topic, field and unit of a signal in a bag."""

    topic: str
    field: str = 'data'  # e.g. 'effort[2]', 'pose.position.x', or 'position[elbow]' in a message with `name`
    unit: str = '1'  # any unit of pint; '0.2 um' for counts of that size

    def __str__(self):
        return f'{self.topic} {self.field}'


@dataclass(frozen=True)
class Series:
    """Values of a signal over time, in the unit of the bag; times increase strictly."""

    times: np.ndarray  # (N,) int64 [ns]
    values: np.ndarray  # (N,)
    clock: str  # RECEPTION or STAMPS


def read_series(path, signals):
    """
    Return ({name: Series}, warnings) of the `Signal`s {name: signal} in the bag `path`.

    Raises
    ------
    BagError
        If `path` cannot be read, or lacks a topic or field.
    IdentificationError
        If a signal has fewer than two samples, or its clock steps back or stands.

    """
    found, warnings, series = _read(Path(path), signals), [], {}
    for name, signal in signals.items():
        samples, skipped = found[name]
        where = f'{Path(path).name}: {signal}'
        total = len(samples) + sum(skipped.values())
        reasons = '; '.join(f'{count} {reason}' for reason, count in skipped.items())
        if not samples and skipped:
            raise BagError(f'{path}: {signal.topic}: no number at {signal.field!r} in {total} messages: {reasons}')
        if len(samples) < 2:
            raise IdentificationError(f'{path}: {signal.topic} has {len(samples)} messages; at least 2 are needed')
        if skipped:
            warnings.append(f'{where}: {total - len(samples)} of {total} messages are skipped: {reasons}')
        series[name] = _on_a_clock(where, samples, warnings)
    return series, list(dict.fromkeys(warnings))


def _on_a_clock(where, samples, warnings):
    """Return the `Series` of `samples` (stamp or None, time of reception, value) in the order of the bag."""
    stamps = np.array([-1 if stamp is None else stamp for stamp, _, _ in samples], dtype=np.int64)
    received = np.array([time for _, time, _ in samples], dtype=np.int64)
    values = np.array([value for *_, value in samples])
    clock = RECEPTION if (stamps <= 0).all() else STAMPS
    if clock == RECEPTION:
        if stamps[0] == 0:
            warnings.append(f'{where}: all {len(stamps)} header stamps are 0; the {RECEPTION} is used')
        order = np.argsort(received, kind='stable')
        return _without_doubles(where, received[order], values[order], clock, warnings)
    zero = stamps <= 0
    if zero.sum() > 1:  # simulated time may begin at 0
        warnings.append(f'{where}: {zero.sum()} of {len(stamps)} messages are skipped: their header stamp is 0')
        stamps, values = stamps[~zero], values[~zero]
    _refuse_steps_back(where, stamps, warnings)
    order = np.argsort(stamps, kind='stable')
    return _without_doubles(where, stamps[order], values[order], clock, warnings)


def _refuse_steps_back(where, stamps, warnings):
    """Refuse stamps that fall back by more than a swap of neighbours; warn of swaps."""
    steps = np.diff(stamps)
    late = np.maximum.accumulate(stamps)[:-1] - stamps[1:]
    behind = np.count_nonzero(late > 0)
    if not behind:
        return
    usual, worst = float(np.median(np.abs(steps))), int(np.argmax(late))
    if late[worst] > _LATE * usual:
        raise IdentificationError(
            f'{where}: the clock steps back by {1e-9 * late[worst]:.6g} s at message {worst + 1}; the usual step is '
            f'{1e-9 * usual:.6g} s; use the part of the bag before or after it'
        )
    warnings.append(f'{where}: {behind} messages arrived after a later one; they are sorted by their stamps')


def _without_doubles(where, times, values, clock, warnings):
    """Return the `Series` without messages at the time of the one before; refuse many that contradict each other."""
    new = np.append(True, np.diff(times) > 0)
    if not new.all():
        contradict = np.count_nonzero(~new & (values != np.roll(values, 1)))
        if new.sum() < 2 or contradict > _CONTRADICT * len(times):
            raise IdentificationError(
                f'{where}: {len(times) - new.sum()} of {len(times)} messages have the time of the one before '
                f'({clock}), {contradict} of them with another value; allowed {100 * _CONTRADICT:g} %'
            )
        warnings.append(f'{where}: {len(times) - new.sum()} messages have the time of the one before; they are skipped')
    return Series(times[new], values[new], clock)


def _read(path, signals):
    """Return {name: (list of (stamp or None, time of reception, value), {reason: messages skipped})}."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics = {signal.topic for signal in signals.values()}
    _check_files(path, topics)
    found = {name: ([], defaultdict(int)) for name in signals}
    where = str(path)
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            missing = topics - set(reader.topics)
            if missing:
                raise BagError(f'{path}: has no topic {sorted(missing)}; it has {sorted(reader.topics)}')
            connections = [connection for connection in reader.connections if connection.topic in topics]
            for connection, received, data in reader.messages(connections=connections):
                where = f'{path}: {connection.topic}'
                message = reader.deserialize(data, connection.msgtype)
                stamp = getattr(getattr(message, 'header', None), 'stamp', None)
                if stamp is not None:
                    stamp = 10**9 * stamp.sec + stamp.nanosec
                for name, signal in signals.items():
                    if signal.topic == connection.topic:
                        _take(found[name], stamp, received, message, signal)
    except BagError:
        raise
    except Exception as error:  # rosbags raises whatever an odd file leads to
        raise BagError(f'{where}: cannot be read as a bag: {reason_of(error)}') from None
    return found


def _check_files(path, topics):
    """Refuse what rosbags would wait for, allocate or unpack without bounds."""
    if not path.exists():
        raise BagError(f'{path}: no such file or folder')
    files = [path]
    if path.is_dir():
        if not (path / 'metadata.yaml').exists():
            raise BagError(f'{path}: has no metadata.yaml; expected a rosbag2 folder, an MCAP file or a ROS 1 bag')
        files = [path / Path(name).name for name in read_metadata(path)['relative_file_paths']]
    for file in files:
        if not file.is_file():
            raise BagError(f'{file}: is no regular file' if file.exists() else f'{file}: no such file')
        if file.suffix == '.mcap':
            with opened(file) as mcap:
                for _ in mcap.messages(topics):
                    pass


def _take(found, stamp, received, message, signal):
    """Append the number that `signal` names in `message`, or count why there is none."""
    samples, skipped = found
    try:
        value = _value(message, signal.field)
    except (LookupError, ValueError):
        skipped[f'without {signal.field}'] += 1
        return
    except (AttributeError, TypeError) as error:
        raise BagError(f'{signal.topic}: no number at {signal.field!r}: {error}') from None
    if isfinite(value):
        samples.append((stamp, received, value))
    else:
        skipped[f'with {signal.field} not finite'] += 1


def _value(message, field):
    """Return the number at `field` of `message`; LookupError or ValueError if this message lacks it."""
    value = message
    for part in field.split('.'):
        name, _, index = part.partition('[')
        value = getattr(value, name)
        if index:
            index = index.rstrip(']')
            value = value[int(index) if index.isdigit() else list(message.name).index(index)]
    if isinstance(value, str):
        raise TypeError(f'{value[:40]!r} is a text')
    return float(value)
