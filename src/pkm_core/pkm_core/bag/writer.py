"""
Writes a bag: a rosbag2 folder of one MCAP file, or of several if it is split, and a metadata.yaml.

Each chunk of at most 64 KiB is passed to the operating system when it is full. A killed recorder or a full disk
therefore loses at most one chunk; `pkm bag-doctor` recovers the others.
"""

import sys
import zlib
from collections import Counter
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from textwrap import indent

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.reader import SeekingReader
from mcap.records import Chunk
from mcap.writer import CompressionType

from pkm_core.bag.mcap_blocks import RECORD_HEAD, BlockWriter
from pkm_core.bag.message_types import typestore
from pkm_core.bag.reader import damage_refused
from pkm_core.bag.rosbag2 import NEVER, RECORDED_QOS, FileFacts, bag_information, channel_facts, dump
from pkm_core.errors import BagError

CHUNK_BYTES = 64 * 1024
# bytes of a message in a chunk in addition to its data: opcode and length, channel, sequence and two times
_MESSAGE_OVERHEAD = RECORD_HEAD + 22


class BagWriter:
    """
    Writes serialized messages into one bag folder.

    Parameters
    ----------
    path : Path
        Folder of the bag; it must not exist.
    topics : dict of str to str
        Message type by topic, e.g. ``{'/pkm/d1/encoder': 'pkm_interfaces/msg/EncoderSample'}``.
    metadata : dict of str to str
        Facts known at the start: record `pkm` of every MCAP file, and custom data of metadata.yaml.
    types : Typestore, optional
        Definitions of the types; by default the installed ones.

    Attributes
    ----------
    counts : Counter
        Messages written so far, by topic.

    """

    def __init__(self, path, topics, metadata, types=None):
        types = types or typestore()
        self._hashes = {topic: _definition(types, kind)[1] for topic, kind in topics.items()}
        self._schemas = {kind: _definition(types, kind)[0] for kind in sorted(set(topics.values()))}
        self._qos = {}  # of topics added later
        self.path = Path(path)
        self._topics, self._metadata = dict(topics), metadata
        self.counts = Counter()
        self._closed = []  # FileFacts of the finished files
        self.path.mkdir(parents=True)
        self._begin_file()

    def _begin_file(self):
        self._file = self.path / f'{self.path.name}_{len(self._closed)}.mcap'
        self._stream = self._file.open('wb')
        # only `_flush` ends chunks: one ended by the writer itself would stay in the stream's buffer
        options = {'compression': CompressionType.ZSTD, 'enable_data_crcs': True}
        self._writer = BlockWriter(self._stream, chunk_size=sys.maxsize, **options)
        self._writer.start(profile='ros2', library='pkm_core')
        schemas = {kind: self._writer.register_schema(kind, 'ros2msg', text) for kind, text in self._schemas.items()}
        self._channels = {
            topic: self._writer.register_channel(topic, 'cdr', schemas[kind], self._facts_of(topic))
            for topic, kind in self._topics.items()
        }
        self._schema_ids = schemas
        self._writer.add_metadata('pkm', self._metadata)
        self._before = self.counts.copy()
        self._flush()
        self._cut = False

    def _facts_of(self, topic):
        return channel_facts(self._hashes[topic], self._qos.get(topic, RECORDED_QOS))

    def add_topic(self, topic, kind, types, qos):
        """Add a topic found while the bag is written: its message type `kind`, defined in `types`, and its `Qos`."""
        definition, self._hashes[topic] = _definition(types, kind)
        self._qos[topic], self._topics[topic] = qos, kind
        if kind not in self._schemas:
            self._schemas[kind] = definition
            self._schema_ids[kind] = self._writer.register_schema(kind, 'ros2msg', definition)
        self._channels[topic] = self._writer.register_channel(
            topic, 'cdr', self._schema_ids[kind], self._facts_of(topic)
        )

    def _flush(self):
        """End the chunk and pass it to the operating system, which keeps it if this process is killed."""
        self._writer.flush()
        self._unsaved, self._cut = 0, True

    def write(self, topic, data, time):
        """Add the serialized message `data` at simulated `time` [ns]."""
        self.write_block(topic, np.frombuffer(data, np.uint8)[np.newaxis], np.array([time]))

    def write_block(self, topic, messages, times):
        """Add serialized messages of equal size, the rows of an (n, size) array of bytes, at `times` (n,) [ns]."""
        size = _MESSAGE_OVERHEAD + messages.shape[1]
        while len(messages):
            fitting = -(-(CHUNK_BYTES - self._unsaved) // size)  # a chunk ends with the message that fills it
            now = messages[:fitting]
            self._writer.add_messages(self._channels[topic], times[:fitting], now, self.counts[topic])
            self.counts[topic] += len(now)
            self._unsaved += size * len(now)
            if self._unsaved >= CHUNK_BYTES:
                self._flush()
            messages, times = messages[fitting:], times[fitting:]

    def keep_together(self):
        """Flush if a chunk has ended since the last call, so that all topics on disk end at the same tick."""
        if self._cut and self._unsaved:
            self._flush()
        self._cut = False

    def split(self):
        """Finish the file and continue in a new file of the same bag."""
        self._finish_file({})
        self._begin_file()

    def close(self, facts):
        """
        Finish the bag and read it back.

        Parameters
        ----------
        facts : dict of str to str
            Facts known at the end: record `pkm_end` of the last MCAP file, and custom data of metadata.yaml.

        Raises
        ------
        BagError
            If a file lacks a written message, or one of its chunks is damaged.

        """
        self._writer.add_metadata('pkm_end', facts)
        text = self._finish_file(facts)
        if len(self._closed) > 1:
            text = dump(self._information(self._closed, self.counts, facts))
        text = 'rosbag2_bagfile_information:\n' + indent(text, '  ')
        (self.path / 'metadata.yaml').write_text(text, encoding='utf-8')

    def abandon(self):
        """Close the file after a failure; chunks passed to the operating system are kept."""
        with suppress(OSError):  # the buffered data may fail again
            self._stream.close()

    def _finish_file(self, facts):
        """Finish the file, read it back and return its metadata as YAML."""
        counts = self.counts - self._before
        start, end = self._writer.span() if counts else (NEVER, NEVER)
        done = FileFacts(self._file.name, start, end - start, counts.total())
        self._closed.append(done)
        text = dump(self._information([done], counts, facts))
        self._writer.add_metadata('rosbag2', {'serialized_metadata': text})
        self._writer.finish()
        self._stream.close()
        _verify(self._file, {self._channels[topic]: count for topic, count in counts.items()})
        return text

    def _information(self, files, counts, facts):
        topics = [
            (topic, kind, self._hashes[topic], counts[topic], self._qos.get(topic, RECORDED_QOS))
            for topic, kind in self._topics.items()
        ]
        return bag_information(files, topics, custom_data=self._metadata | facts)


@lru_cache(maxsize=64)
def _definition(types, kind):
    """Return the definition of the message type `kind` as the bytes of a schema, and its RIHS01 hash."""
    return types.generate_msgdef(kind, ros_version=2)[0].encode(), types.hash_rihs01(kind)


def _verify(file, counts):
    """Read the MCAP file `file` back; raise `BagError` on a wrong checksum or other `counts` by channel."""
    unpack = zstandard.ZstdDecompressor()
    with damage_refused(file), file.open('rb') as stream:
        summary = SeekingReader(stream, record_size_limit=file.stat().st_size).get_summary()
        for index in summary.chunk_indexes:
            stream.seek(index.chunk_start_offset + RECORD_HEAD)
            chunk = Chunk.read(ReadDataStream(stream))
            content = unpack.decompress(chunk.data, max_output_size=chunk.uncompressed_size)
            if zlib.crc32(content) != chunk.uncompressed_crc:
                raise BagError(f'{file}: a written chunk is damaged: wrong checksum')
    held = {channel: count for channel, count in summary.statistics.channel_message_counts.items() if count}
    if held != counts:
        raise BagError(f'{file}: holds {sum(held.values())} messages; {sum(counts.values())} were written')
