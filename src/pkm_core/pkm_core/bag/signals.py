"""Signals of any bag by topic, field and unit: rosbag2 folders, MCAP files and ROS 1 bags."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.bag.reader import opened, read_metadata, reason_of
from pkm_core.errors import BagError


@dataclass(frozen=True)
class Signal:
    """Topic, field and unit of a signal in a bag."""

    topic: str
    field: str = 'data'  # e.g. 'effort[2]', 'pose.position.x', or 'position[elbow]' in a message with `name`
    unit: str = '1'  # any unit of pint; '0.2 um' for counts of that size

    def __str__(self):
        return f'{self.topic} {self.field}'


def read_signals(path, signals):
    """
    Return {name: (times [s], values)} of the `signals` {name: Signal} in the order of recording.

    The time of a value is the header stamp of its message; without a header it is the time of reception. All signals
    have one origin of time. Values are in the unit of the message.

    Raises
    ------
    BagError
        If `path` cannot be read, or lacks a topic; if a message lacks its field, or a signal has fewer than two.

    """
    found, times = read_samples(path, signals), {}
    for name, (samples, skipped) in found.items():
        signal = signals[name]
        for reason, count in skipped.items():
            raise BagError(f'{path}: {signal.topic}: no number at {signal.field!r} in {count} messages: {reason}')
        if len(samples) < 2:
            raise BagError(f'{path}: {signal.topic} has {len(samples)} messages; at least 2 are needed')
        times[name] = [received if stamp is None else stamp for stamp, received, _ in samples]
    origin = min(min(each) for each in times.values())  # a double since 1970 resolves only 0.25 us
    return {
        name: (1e-9 * (np.array(times[name]) - origin), np.array([value for *_, value in samples]))
        for name, (samples, _) in found.items()
    }


def read_samples(path, signals):
    """
    Return {name: (samples, {reason: number of messages without the field})} of the `signals` {name: Signal}.

    A sample is (header stamp or None [ns], time of reception [ns], value), in the order of recording; a value need not
    be finite.

    Raises
    ------
    BagError
        If `path` cannot be read, lacks a topic, or a field is no number.

    """
    path = Path(path)
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
    samples.append((stamp, received, value))


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
