"""
Records of an MCAP file, read with bounds.

The mcap package allocates what a length field demands and unpacks a chunk to whatever size it has. Here no read exceeds
the file, a chunk unpacks to exactly the size in its head, and a file unpacks to a limited multiple of its own size.
Source of the format: https://mcap.dev/spec.
"""

import struct
import zlib
from heapq import heappop, heappush
from io import SEEK_END, BytesIO
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

MAGIC = b'\x89MCAP0\r\n'
LARGEST_CHUNK = 256_000_000  # bytes, unpacked; the recorder writes 64 KiB, rosbag2 by default 768 KiB
LARGEST_FREE = 64_000_000  # bytes that a file of any size may unpack to
LARGEST_RATIO = 100  # unpacked over packed, beyond LARGEST_FREE; bags of a machine at rest reach 20
_RECORD = struct.Struct('<BQ')  # opcode and length
_MESSAGE = struct.Struct('<HIQQ')  # channel, sequence, times of logging and of publication
_FOOTER = struct.Struct('<QQI')  # start of the summary and of its offsets, checksum


class DamageError(ValueError):
    """A file that is no MCAP file, is damaged, or unpacks to more than the bounds of this module."""


class RawMessage(NamedTuple):
    """A message of a chunk."""

    channel: int
    time: int  # of logging [ns]
    data: bytes


class _Bounded:
    """A binary file whose `read` never asks for more than the file has left."""

    def __init__(self, stream):
        self._stream = stream
        self.size = stream.seek(0, SEEK_END)
        stream.seek(0)
        self.seek, self.tell = stream.seek, stream.tell

    def read(self, length):
        return self._stream.read(max(0, min(length, self.size - self._stream.tell())))


class McapFile:
    """
    An open MCAP file.

    Parameters
    ----------
    stream : BinaryIO
        A regular file opened for reading.

    Attributes
    ----------
    size : int
        Of the file [bytes].

    """

    def __init__(self, stream):
        self._stream: Any = _Bounded(stream)
        self.size = self._stream.size
        self._unpacked = 0

    def records(self, *, check=False):
        """
        Yield all records in the order of the file, chunks as they are; with `check` the data section's checksum counts.

        Any error of the mcap package ends the iteration at damage.
        """
        self._stream.seek(0)
        options = {'emit_chunks': True, 'validate_crcs': check, 'record_size_limit': self.size}
        yield from StreamReader(self._stream, **options).records

    def tell(self):
        """Return the number of bytes up to the end of the last record that was read."""
        return self._stream.tell()

    def summary(self):
        """
        Return the `Summary` at the end of the file, or None if the file was written without one.

        Raises
        ------
        DamageError
            If the file has no end, or the checksum of the summary is wrong.

        """
        end = _RECORD.size + _FOOTER.size + len(MAGIC)
        self._stream.seek(max(0, self.size - end))
        tail = self._stream.read(end)
        if len(tail) < end or not tail.endswith(MAGIC) or tail[0] != Opcode.FOOTER:
            raise DamageError('the file does not end with the footer of an MCAP file')
        start, _, checksum = _FOOTER.unpack_from(tail, _RECORD.size)
        if start == 0:
            return None
        self._stream.seek(min(start, self.size))
        if checksum and zlib.crc32(self._stream.read(self.size - start - len(MAGIC) - 4)) != checksum:
            raise DamageError('the summary at the end of the file has a wrong checksum')
        self._stream.seek(0)
        return SeekingReader(self._stream, record_size_limit=self.size).get_summary()

    def unpack(self, chunk):
        """
        Return the records of a `Chunk`: `Schema`, `Channel` and `RawMessage`.

        Raises
        ------
        DamageError
            If it is damaged, or unpacks to more than the bounds.

        """
        allowed = LARGEST_FREE + LARGEST_RATIO * self.size
        self._unpacked += chunk.uncompressed_size
        if chunk.uncompressed_size > LARGEST_CHUNK or self._unpacked > allowed:
            most = min(LARGEST_CHUNK, allowed) / 1e6
            raise DamageError(f'unpacks to more than {most:.0f} MB; the file has {self.size / 1e6:.2g} MB')
        content = _decompressed(chunk)
        if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
            raise DamageError('a chunk has a wrong checksum')
        return list(_records_in(content))

    def messages(self, topics=None):
        """
        Yield (topic, name of the schema, serialized bytes, time [ns]), oldest first, for `topics` or all.

        Messages of the same time are in the order of the file.
        """
        summary = self.summary()
        if summary is None or not summary.chunk_indexes:
            yield from self._scanned_messages(topics)
            return
        names = _wanted(summary.channels, summary.schemas, topics)
        waiting = []
        for index in sorted(summary.chunk_indexes, key=lambda each: (each.message_start_time, each.chunk_start_offset)):
            if index.message_index_offsets and names.keys().isdisjoint(index.message_index_offsets):
                continue
            while waiting and waiting[0][0] < index.message_start_time:
                yield heappop(waiting)[3]
            for number, record in enumerate(self._records_at(index, summary.channels)):
                if type(record) is RawMessage and record.channel in names:
                    message = (*names[record.channel], record.data, record.time)
                    heappush(waiting, (record.time, index.chunk_start_offset, number, message))
        while waiting:
            yield heappop(waiting)[3]

    def _records_at(self, index, channels):
        """Return the records of the chunk that a `ChunkIndex` names; an error names its topics."""
        try:
            return self.unpack(Chunk.read(self._record_at(index.chunk_start_offset, Opcode.CHUNK)))
        except Exception as error:  # the packages that decompress raise whatever the damage leads to
            held = sorted({channels[number].topic for number in index.message_index_offsets if number in channels})
            more = f' and {len(held) - 2} more' if len(held) > 2 else ''
            raise DamageError(f'{", ".join(held[:2])}{more}: {error}' if held else str(error)) from None

    def metadata(self, summary):
        """Yield the `Metadata` records that the `summary` of this file names."""
        for index in summary.metadata_indexes:
            yield Metadata.read(self._record_at(index.offset, Opcode.METADATA))

    def _record_at(self, offset, kind):
        """Return the stream behind the head of the record of a `kind` at `offset`."""
        self._stream.seek(min(offset, self.size))
        opcode, _ = _RECORD.unpack(self._stream.read(_RECORD.size))
        if opcode != kind:
            raise DamageError(f'the summary names a record of kind {kind:d} at byte {offset}, where there is none')
        return ReadDataStream(self._stream)

    def contents(self):
        """Yield every Schema, Channel and `RawMessage` of the complete records, those in chunks too, in their order."""
        for record in self.records():
            for inner in self.unpack(record) if isinstance(record, Chunk) else [record]:
                if isinstance(inner, (Schema, Channel, RawMessage)):
                    yield inner
                elif isinstance(inner, Message):
                    yield raw(inner)

    def _scanned_messages(self, topics):
        """As `messages`, of a file without an index of its chunks: all are held at once."""
        channels, schemas, found = {}, {}, []
        for record in self.contents():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            else:
                found.append(record)
        names = _wanted(channels, schemas, topics)
        known = (message for message in found if message.channel in names)
        for message in sorted(known, key=lambda each: each.time):
            yield (*names[message.channel], message.data, message.time)


def raw(message):
    """Return a `Message` of the mcap package as a `RawMessage`."""
    return RawMessage(message.channel_id, message.log_time, message.data)


def _wanted(channels, schemas, topics):
    """Return {channel: (topic, name of its schema)} of `topics` or of all; `DamageError` without a schema."""
    names = {}
    for number, channel in channels.items():
        if topics is None or channel.topic in topics:
            if channel.schema_id not in schemas:
                raise DamageError(f'{channel.topic}: its messages have no schema')
            names[number] = channel.topic, schemas[channel.schema_id].name
    return names


def _decompressed(chunk):
    """Return the content of a `Chunk`, of exactly the size in its head."""
    size, data = chunk.uncompressed_size, chunk.data
    if chunk.compression == 'zstd':
        # a frame of another size would be allocated at whatever size it states
        exact = zstandard.frame_content_size(data) == size
        data = zstandard.ZstdDecompressor().decompress(data) if exact else _streamed(data, size)
    elif chunk.compression == 'lz4':
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif chunk.compression:
        raise DamageError(f'a chunk is compressed by {chunk.compression[:20]!r}; known: zstd, lz4')
    if len(data) != size:
        raise DamageError(f'a chunk does not unpack to the {size} bytes in its head')
    return data


def _streamed(data, size):
    """Return at most `size` + 1 bytes of the zstd frame `data`."""
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        return reader.read(size + 1)


def _records_in(content):
    """Yield the records of an unpacked chunk; `DamageError` if one exceeds the chunk."""
    at, size = 0, len(content)
    while at < size:
        if size - at < _RECORD.size:
            raise DamageError('a chunk ends within a record')
        opcode, length = _RECORD.unpack_from(content, at)
        at += _RECORD.size
        end = at + length
        if end > size or opcode == 0:
            raise DamageError(f'a record of a chunk has kind {opcode} and {length} bytes; {size - at} are left')
        if opcode == Opcode.MESSAGE:
            if length < _MESSAGE.size:
                raise DamageError(f'a message record has {length} bytes; expected at least {_MESSAGE.size}')
            channel, _, time, _ = _MESSAGE.unpack_from(content, at)
            yield RawMessage(channel, time, content[at + _MESSAGE.size : end])
        elif opcode in _INSIDE:
            yield _INSIDE[opcode].read(ReadDataStream(BytesIO(content[at:end])))
        at = end


_INSIDE: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}
