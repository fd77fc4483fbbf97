"""
Motion cycles as rosbag2 folders: one MCAP file and a metadata.yaml each, written and read without ROS.

Messages carry the simulated time of their tick. Chunks of 64 KiB go to the operating system one by one, so a
recorder that is killed loses at most the one it was filling; `pkm bag-doctor` makes a whole bag of the rest.
"""

import struct
import sys
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import yaml
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.writer import CompressionType, Writer
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from zstandard import ZstdError

from pkm_core.errors import BagError
from pkm_core.message_types import types_of, typestore
from pkm_core.rosbag2 import NEVER, bag_information, channel_facts, dump

CHUNK_BYTES = 64 * 1024
# what a message takes in a chunk beside its data: opcode, length, channel, sequence and two times
_MESSAGE_OVERHEAD = 31
# the ways in which a damaged file shows; the checksums of its chunks turn most into a ValueError
DAMAGE = (McapError, SerdeError, TypesysError, ZstdError, struct.error, ValueError, KeyError)


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
        Facts about the recording that are known now: record `pkm` of the MCAP file, custom data of metadata.yaml.
    types : Typestore, optional
        Where the types are defined; those installed by default.

    """

    def __init__(self, path, topics, metadata, types=None):
        types = types or typestore()
        self._hashes = {topic: types.hash_rihs01(kind) for topic, kind in topics.items()}
        self.path = Path(path)
        self.path.mkdir(parents=True)
        self._file = self.path / f'{self.path.name}_0.mcap'
        self._topics, self._metadata = topics, metadata
        self._stream = self._file.open('wb')
        # chunks end where `_flush` ends them: one that the writer ended by itself would stay in the stream's buffer
        self._writer = Writer(self._stream, chunk_size=sys.maxsize, compression=CompressionType.ZSTD)
        self._writer.start(profile='ros2', library='pkm_core')
        schemas = {}
        for message_type in sorted(set(topics.values())):
            text, _ = types.generate_msgdef(message_type, ros_version=2)
            schemas[message_type] = self._writer.register_schema(message_type, 'ros2msg', text.encode())
        self._channels = {
            topic: self._writer.register_channel(topic, 'cdr', schemas[kind], channel_facts(self._hashes[topic]))
            for topic, kind in topics.items()
        }
        self._writer.add_metadata('pkm', metadata)
        self._flush()
        self.counts = Counter()
        self._start, self._end = NEVER, 0

    def _flush(self):
        """End the chunk and hand it to the operating system, which keeps it whatever happens to this process."""
        self._writer.flush()
        self._unsaved = 0

    def write(self, topic, data, time):
        """Add the serialized message `data` at simulated `time` [ns]."""
        self._start, self._end = min(self._start, time), max(self._end, time)
        self._writer.add_message(self._channels[topic], time, data, time, self.counts[topic])
        self.counts[topic] += 1
        self._unsaved += _MESSAGE_OVERHEAD + len(data)
        if self._unsaved >= CHUNK_BYTES:
            self._flush()

    def close(self, facts):
        """
        Finish the file, write metadata.yaml and read the file's summary back.

        Parameters
        ----------
        facts : dict of str to str
            What is known only now: record `pkm_end` of the MCAP file, and custom data of metadata.yaml too.

        Raises
        ------
        BagError
            If the file does not hold every message that was written.

        """
        self._writer.add_metadata('pkm_end', facts)
        info = bag_information(
            self._file.name,
            [(topic, kind, self._hashes[topic], self.counts[topic]) for topic, kind in self._topics.items()],
            start=self._start,
            duration=max(0, self._end - self._start),
            custom_data=self._metadata | facts,
        )
        self._writer.add_metadata('rosbag2', {'serialized_metadata': dump(info)})
        self._writer.finish()
        self._stream.close()
        (self.path / 'metadata.yaml').write_text(dump({'rosbag2_bagfile_information': info}), encoding='utf-8')
        with _reader(self._file) as reader:
            statistics = reader.get_summary().statistics
        held = {topic: statistics.channel_message_counts.get(channel, 0) for topic, channel in self._channels.items()}
        if any(held[topic] != self.counts[topic] for topic in held):
            raise BagError(f'{self._file}: holds {held} messages; {dict(self.counts)} were written')


@contextmanager
def damage_refused(file, advice=''):
    """Turn whatever an unreadable or damaged `file` makes its readers raise into one `BagError`."""
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror}') from None
    except (AttributeError, *DAMAGE) as error:  # AttributeError: there is no summary, or no schema
        raise BagError(f'{file}: cannot be read as a bag: {_reason(error)}{advice}') from None


@contextmanager
def _reader(path):
    """Open the bag `path` and yield the reader of its MCAP file."""
    file = bag_file(path)
    with damage_refused(file, f'; try: pkm bag-doctor {path}'), file.open('rb') as stream:
        yield SeekingReader(stream, validate_crcs=True, record_size_limit=file.stat().st_size)


def _reason(error):
    """Return what `error` says, in one line."""
    return ' '.join(str(error).split()) or type(error).__name__


def read_metadata(path):
    """Return what metadata.yaml says of the bag folder `path`."""
    file = Path(path) / 'metadata.yaml'
    if not file.exists() and any(Path(path).glob('*.mcap')):
        raise BagError(f'{path}: has no metadata.yaml, as when its recorder was killed; try: pkm bag-doctor {path}')
    try:
        return yaml.load(file.read_text(encoding='utf-8'), yaml.CSafeLoader)['rosbag2_bagfile_information']
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        raise BagError(f'{file}: cannot be read as the metadata of a bag: {_reason(error)}') from None


def bag_file(path):
    """Return the one MCAP file of the bag folder `path`, or `path` if it is a file; `BagError` otherwise."""
    path = Path(path)
    if path.is_file():
        return path
    if not path.exists():
        raise BagError(f'{path}: no such file or folder')
    files = sorted(path.glob('*.mcap'))
    if len(files) != 1:
        raise BagError(f'{path}: is no bag of this cell: has {len(files)} MCAP files; expected 1')
    return files[0]


def raw_messages(path, topics=None):
    """
    Yield (topic, message type, serialized bytes, time [ns]) of the bag `path`, oldest first, for `topics` or all.

    Messages of the same time come in the order in which they were recorded.

    Raises
    ------
    BagError
        If `path` is no bag or cannot be read.

    """
    with _reader(path) as reader:
        for schema, channel, message in reader.iter_messages(topics):
            yield channel.topic, schema.name, message.data, message.log_time


def read_topics(path, topics=None):
    """
    Return the messages of the bag `path` by topic, oldest first.

    Parameters
    ----------
    path : Path
        Folder of the bag, or its MCAP file.
    topics : iterable of str, optional
        Which; all that have messages by default.

    Returns
    -------
    messages : dict of str to list
        Deserialized messages by topic; an empty list where a topic that was asked for has none.

    Raises
    ------
    BagError
        If `path` is no bag or cannot be read.

    """
    messages = {topic: [] for topic in topics or ()}
    with _reader(path) as reader:
        types = types_of(reader.get_summary().schemas.values())
        for topic, kind, data, _ in raw_messages(path, topics):
            messages.setdefault(topic, []).append(types.deserialize_cdr(data, kind))
    return messages


def column(messages, field):
    """Return one field of `messages` as an array, a row a message."""
    return np.array([getattr(message, field) for message in messages])


def writable_folder(path):
    """Return the folder `path`, made if need be; `BagError` if nothing can be written there."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / '.pkm-probe'
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BagError(f'{path}: cannot be written: {error.strerror}') from None
    return path
