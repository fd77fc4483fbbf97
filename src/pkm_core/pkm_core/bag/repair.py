"""
Repair of a bag whose recorder was killed: its MCAP file is truncated, without a summary and without metadata.yaml.

Every intact chunk, by length and checksum, is copied to a new bag next to the old one.
"""

import json
import shutil
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from pkm_core.bag.message_types import types_of
from pkm_core.bag.reader import DAMAGE, bag_files, damage_refused, raw_messages, read_metadata
from pkm_core.bag.writer import BagWriter
from pkm_core.errors import BagError

_INTERFACES = 'pkm_interfaces/msg/'
_RUN = 0  # EncoderSample.RUN
_ENDED = (2, 4)  # CycleEvent.FINISHED and FAULT


@dataclass(frozen=True)
class Repair:
    """Result of a repair."""

    path: Path  # folder of the new bag
    saved: dict[str, int]  # messages by topic
    missing: dict[str, list[tuple[int, int]]]  # by topic of the servo tick: (first, last) of the ticks not saved
    damaged_chunks: int  # of the right length, with a wrong checksum
    lost_bytes: int  # of the file, after its last whole record


class _Salvage:
    """Intact content of the MCAP `files` of one bag."""

    def __init__(self, files):
        self.metadata = {}
        self.damaged_chunks = 0
        self.lost_bytes = 0  # after the last whole record of a file
        self._schemas, self._channels, self._messages = {}, {}, []
        for file in files:
            with damage_refused(file):
                self._read(file)

    def _read(self, file):
        end = 0
        with file.open('rb') as stream:
            records = StreamReader(stream, emit_chunks=True, record_size_limit=file.stat().st_size).records
            try:
                for record in records:
                    end = stream.tell()
                    self._take(record)
            except DAMAGE:
                pass  # end of the intact records
        self.lost_bytes += file.stat().st_size - end

    @cached_property
    def types(self):
        """The message types defined in the file."""
        return types_of(self._schemas.values())

    @cached_property
    def topics(self):
        """Message type by topic."""
        return {channel.topic: self._schemas[channel.schema_id].name for channel in self._channels.values()}

    def _take(self, record):
        if isinstance(record, Chunk):
            try:
                content = breakup_chunk(record, validate_crc=True)
            except DAMAGE:
                self.damaged_chunks += 1
                return
            for inner in content:
                self._take(inner)
        elif isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)  # the copies in the summary have no checksum
        elif isinstance(record, Channel):
            self._channels.setdefault(record.id, record)
        elif isinstance(record, Message):
            self._messages.append(record)
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata

    def messages(self):
        """Return (topic, serialized bytes, time [ns]) in the order of the file."""
        known = [m for m in self._messages if m.channel_id in self._channels]
        return [(self._channels[m.channel_id].topic, m.data, m.log_time) for m in known]

    def read(self, name):
        """Return the messages of the type `name` of pkm_interfaces by topic, an empty list where nothing is whole."""
        kind = _INTERFACES + name
        read = {topic: [] for topic, its_kind in self.topics.items() if its_kind == kind}
        for topic, data, _ in self.messages():
            if topic in read:
                read[topic].append(self.types.deserialize_cdr(data, kind))
        return read


def repair(path):
    """
    Copy the intact chunks of the bag `path` to a new bag PATH_repaired; `path` itself is not changed.

    Parameters
    ----------
    path : Path
        Folder of the bag, or its MCAP file.

    Returns
    -------
    repair : Repair or None
        None if the bag is intact.

    Raises
    ------
    BagError
        If `path` is not a bag of this cell, has no intact chunk, or the new bag exists or cannot be written.

    """
    path = Path(path).resolve()
    files = bag_files(path)
    found = _Salvage(files)
    with damage_refused(files[-1]):
        if 'pkm' not in found.metadata:
            raise BagError(f"{files[-1]}: not a bag of this cell: has no MCAP metadata record 'pkm'")
        if _is_whole(path):
            return None
        if not found.messages():
            raise BagError(f'{files[-1]}: has no intact chunk of messages; nothing can be saved')
        encoders, commands = found.read('EncoderSample'), found.read('MotorCommand')
        planned = _planned_ticks(found, encoders, commands)
    there = {topic: {m.tick for m in messages} for topic, messages in (encoders | commands).items()}
    target = path.with_name(f'{path.name.removesuffix(".mcap")}_repaired')
    expected = {topic: len(ticks) for topic, ticks in planned.items()}
    _write(target, found, expected, ', '.join(file.name for file in files))
    counts = Counter(topic for topic, *_ in found.messages())
    return Repair(
        path=target,
        saved={topic: counts[topic] for topic in found.topics},
        missing={topic: _ranges(sorted(set(ticks) - there[topic])) for topic, ticks in planned.items()},
        damaged_chunks=found.damaged_chunks,
        lost_bytes=found.lost_bytes,
    )


def _write(target, found, expected, name):
    """Write the new bag."""
    if target.exists():
        raise BagError(f'{target}: exists and is not overwritten')
    try:
        writer = BagWriter(target, found.topics, found.metadata['pkm'], found.types)
        for message in found.messages():
            writer.write(*message)
        writer.close({'expected': json.dumps(expected), 'repaired_from': name})
    except OSError as error:
        shutil.rmtree(target, ignore_errors=True)
        raise BagError(f'{target}: cannot be written: {error.strerror}') from None


def _is_whole(path):
    try:
        return read_metadata(path)['message_count'] == sum(1 for _ in raw_messages(path))
    except BagError:
        return False


def _planned_ticks(found, encoders, commands):
    """Return {topic of the servo tick: its ticks} up to the end of the cycle or, without an event, its planned end."""
    running = [m for samples in encoders.values() for m in samples if m.mode == _RUN]
    trajectories = [m for messages in found.read('SampledTrajectory').values() for m in messages]
    if not running or not trajectories:
        return {}
    first = running[0].tick - running[0].index
    encoder_end = command_end = first + len(trajectories[-1].position) // len(trajectories[-1].coordinates)
    for event in (m for messages in found.read('CycleEvent').values() for m in messages):
        if event.event in _ENDED:
            encoder_end, command_end = event.tick, first + event.samples
    return dict.fromkeys(encoders, range(first, encoder_end)) | dict.fromkeys(commands, range(first, command_end))


def _ranges(ticks):
    """Return (first, last) of every range of consecutive numbers in the sorted list `ticks`."""
    starts = [tick for i, tick in enumerate(ticks) if i == 0 or ticks[i - 1] != tick - 1]
    ends = [tick for i, tick in enumerate(ticks) if i == len(ticks) - 1 or ticks[i + 1] != tick + 1]
    return list(zip(starts, ends, strict=True))
