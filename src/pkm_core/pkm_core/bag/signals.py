"""Signals of any bag by topic, field and unit: rosbag2 folders, MCAP files and ROS 1 bags."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.errors import BagError


@dataclass(frozen=True)
class Signal:
    """Topic, field and unit of a signal in a bag."""

    topic: str
    field: str = 'data'  # e.g. 'effort[2]', 'pose.position.x', or 'position[elbow]' in a message with `name`
    unit: str = '1'  # any unit of pint; '0.2 um' for counts of that size


def read_signals(path, signals):
    """
    Return {name: (times [s], values)} of the `signals` {name: Signal} in the order of recording.

    The time of a value is the header stamp of its message; without a header it is the time of reception. All signals
    have one origin of time. Values are in the unit of the message.

    Raises
    ------
    BagError
        If `path` cannot be read, or lacks a topic or field; or if a signal has fewer than two messages.

    """
    from rosbags.highlevel import AnyReader
    from rosbags.highlevel.anyreader import AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    topics = {signal.topic for signal in signals.values()}
    found = {name: [] for name in signals}
    try:
        with AnyReader([Path(path)], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            missing = topics - set(reader.topics)
            if missing:
                raise BagError(f'{path}: has no topic {sorted(missing)}; it has {sorted(reader.topics)}')
            connections = [connection for connection in reader.connections if connection.topic in topics]
            for connection, received, data in reader.messages(connections=connections):
                message = reader.deserialize(data, connection.msgtype)
                stamp = getattr(getattr(message, 'header', None), 'stamp', None)
                time = received if stamp is None else 10**9 * stamp.sec + stamp.nanosec
                for name, signal in signals.items():
                    if signal.topic == connection.topic:
                        found[name].append((time, _value(message, signal)))
    except (AnyReaderError, OSError, AssertionError) as error:
        raise BagError(f'{path}: cannot be read as a bag: {error}') from None
    for name, pairs in found.items():
        if len(pairs) < 2:
            raise BagError(f'{path}: {signals[name].topic} has {len(pairs)} messages; at least 2 are needed')
    origin = min(time for pairs in found.values() for time, _ in pairs)  # a double since 1970 resolves only 0.25 us
    series = {}
    for name, pairs in found.items():
        times, values = np.array([(1e-9 * (time - origin), value) for time, value in pairs]).T
        series[name] = times, values
    return series


def _value(message, signal):
    """Return the number that `signal` names in `message`."""
    value = message
    try:
        for part in signal.field.split('.'):
            name, _, index = part.partition('[')
            value = getattr(value, name)
            if index:
                index = index.rstrip(']')
                value = value[int(index) if index.isdigit() else list(message.name).index(index)]
        return float(value)
    except (AttributeError, IndexError, ValueError, TypeError) as error:
        raise BagError(f'{signal.topic}: no number at {signal.field!r}: {error}') from None
