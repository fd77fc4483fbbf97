"""
Repair of a bag whose recorder was killed: its MCAP file is truncated, without a summary and without metadata.yaml.

Every intact chunk, by length and checksum, is copied to a new bag next to the old one.
"""

import json
import shutil
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mcap.records import Channel, Chunk, Message, Metadata, Schema

from pkm_core.bag.integrity import is_whole
from pkm_core.bag.message_types import types_of
from pkm_core.bag.pieces import SAFE_STOP, extensions, planned
from pkm_core.bag.reader import bag_files, damage_refused, opened, read_metadata
from pkm_core.bag.writer import BagWriter
from pkm_core.errors import BagError
from pkm_core.mcap_records import RawMessage, raw

_INTERFACES = 'pkm_interfaces/msg/'
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
        self._name = files[-1]
        self.metadata = {}
        self.damaged_chunks = 0
        self.lost_bytes = 0  # after the last whole record of a file
        self._schemas, self._channels, self._messages = {}, {}, []
        for file in files:
            with opened(file) as mcap:
                self._read(mcap)

    def _read(self, mcap):
        end = 0
        with suppress(Exception):  # the mcap package raises whatever the damage leads to
            for record in mcap.records():
                end = mcap.tell()
                self._take(mcap, record)
            end = mcap.tell()  # after the magic bytes that follow the footer
        self.lost_bytes += mcap.size - end

    @cached_property
    def types(self):
        """The message types defined in the file."""
        return types_of(self._schemas.values())

    @cached_property
    def topics(self):
        """Message type by topic."""
        orphans = [channel.topic for channel in self._channels.values() if channel.schema_id not in self._schemas]
        if orphans:
            raise BagError(f'{self._name}: {orphans[0]}: its messages have no schema')
        return {channel.topic: self._schemas[channel.schema_id].name for channel in self._channels.values()}

    def _take(self, mcap, record):
        if isinstance(record, Chunk):
            try:
                content = mcap.unpack(record)
            except Exception:  # so do the packages that decompress
                self.damaged_chunks += 1
                return
            for inner in content:
                self._take(mcap, inner)
        elif isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)  # the copies in the summary have no checksum
        elif isinstance(record, Channel):
            self._channels.setdefault(record.id, record)
        elif isinstance(record, RawMessage):
            self._messages.append(record)
        elif isinstance(record, Message):
            self._messages.append(raw(record))
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata

    def messages(self):
        """Return (topic, serialized bytes, time [ns]) in the order of the file."""
        known = [m for m in self._messages if m.channel in self._channels]
        return [(self._channels[m.channel].topic, m.data, m.time) for m in known]

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
        Folder of the bag, or its MCAP file. A file within the folder of a bag stands for that folder.

    Returns
    -------
    repair : Repair or None
        None if the bag is intact, see `is_whole`.

    Raises
    ------
    BagError
        If `path` is not a bag of this cell, has no intact chunk, or the new bag exists or cannot be written.

    """
    path = _bag_of(Path(path).resolve())
    files = bag_files(path)
    found = _Salvage(files)
    with damage_refused(files[-1]):
        if 'pkm' not in found.metadata:
            raise BagError(f"{files[-1]}: not a bag of this cell: has no MCAP metadata record 'pkm'")
        if is_whole(path):
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


def lost_messages(path):
    """
    Return the number of missing messages by topic that the recorder wrote into the bag `path`, or the bag of that file.

    Raises
    ------
    BagError
        If its metadata cannot be read.

    """
    path = _bag_of(Path(path).resolve())
    if not path.is_dir():
        return {}
    try:
        lost = json.loads((read_metadata(path).get('custom_data') or {}).get('lost', '{}'))
    except ValueError as error:
        raise BagError(f"{path}: custom_data 'lost' is no JSON: {error}") from None
    return lost if isinstance(lost, dict) else {}


def _bag_of(path):
    """Return the folder of the bag if `path` is a file in it, else `path`."""
    folder = path.parent
    is_part = (folder / 'metadata.yaml').exists() or path.stem.rpartition('_')[0] == folder.name
    return folder if path.is_file() and is_part else path


def _write(target, found, expected, name):
    """Write the new bag; nothing is left of it if that fails."""
    if target.exists():
        raise BagError(f'{target}: exists and is not overwritten')
    try:
        with damage_refused(name):
            writer = BagWriter(target, found.topics, found.metadata['pkm'], found.types)
            for message in found.messages():
                writer.write(*message)
            writer.close({'expected': json.dumps(expected), 'repaired_from': name})
    except OSError as error:
        shutil.rmtree(target, ignore_errors=True)
        raise BagError(f'{target}: cannot be written: {error.strerror}') from None
    except BagError:
        shutil.rmtree(target, ignore_errors=True)
        raise


def _planned_ticks(found, encoders, commands):
    """Return {topic of the servo tick: its ticks} up to the end of the cycle or, without an event, its planned end."""
    running = [m for samples in encoders.values() for m in samples if m.mode != SAFE_STOP]
    trajectories = [messages for messages in found.read('SampledTrajectory').values() if messages]
    if not running or not trajectories:
        return {}
    first = running[0].tick - running[0].index
    pieces = {getattr(each, 'offset', 0) for each in trajectories[-1]}
    whole = planned(trajectories[-1], extensions(running) & pieces)  # of a jog as far as it is in the bag
    encoder_end = command_end = first + len(whole.position) // len(whole.coordinates)
    for event in (m for messages in found.read('CycleEvent').values() for m in messages):
        if event.event in _ENDED:
            encoder_end, command_end = event.tick, first + event.samples
    return dict.fromkeys(encoders, range(first, encoder_end)) | dict.fromkeys(commands, range(first, command_end))


def _ranges(ticks):
    """Return (first, last) of every range of consecutive numbers in the sorted list `ticks`."""
    starts = [tick for i, tick in enumerate(ticks) if i == 0 or ticks[i - 1] != tick - 1]
    ends = [tick for i, tick in enumerate(ticks) if i == len(ticks) - 1 or ticks[i + 1] != tick + 1]
    return list(zip(starts, ends, strict=True))
