"""
Motion cycles as rosbag2 folders: one MCAP file and a metadata.yaml each, written and read without ROS.

Chunks are 64 KiB, so a recorder that is killed loses little. Messages carry the simulated time of their tick.
"""

from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.highlevel.anyreader import AnyReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pkm_core.config import install_prefixes
from pkm_core.errors import BagError

_CHUNK_BYTES = 64 * 1024
# what every topic of the cell is offered with, in rosbag2's words
_QOS = {
    'history': 'keep_last',
    'depth': 1000,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': {'sec': 9223372036, 'nsec': 854775807},
    'lifespan': {'sec': 9223372036, 'nsec': 854775807},
    'liveliness': 'automatic',
    'liveliness_lease_duration': {'sec': 9223372036, 'nsec': 854775807},
    'avoid_ros_namespace_conventions': False,
}


@cache
def typestore():
    """Return the message types of ROS 2 Jazzy and pkm_interfaces."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for prefix in install_prefixes():
        folder = prefix / 'share' / 'pkm_interfaces' / 'msg'
        if folder.is_dir():
            for path in sorted(folder.glob('*.msg')):
                store.register(get_types_from_msg(path.read_text(encoding='utf-8'), f'pkm_interfaces/msg/{path.stem}'))
            return store
    raise BagError(
        f'pkm_interfaces is not built in any of {[str(p) for p in install_prefixes()]}; run bringup_scripts/setup'
    )


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
        Facts about the recording, kept in the MCAP file and as custom data of metadata.yaml.

    """

    def __init__(self, path, topics, metadata):
        self.path = Path(path)
        self.path.mkdir(parents=True)
        self._file = self.path / f'{self.path.name}_0.mcap'
        self._topics, self._metadata = topics, metadata
        self._stream = self._file.open('wb')
        self._writer = Writer(self._stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile='ros2', library='pkm_core')
        schemas = {}
        for message_type in sorted(set(topics.values())):
            text, _ = typestore().generate_msgdef(message_type, ros_version=2)
            schemas[message_type] = self._writer.register_schema(message_type, 'ros2msg', text.encode())
        qos = yaml.safe_dump([_QOS])
        self._channels = {
            topic: self._writer.register_channel(topic, 'cdr', schemas[kind], {'offered_qos_profiles': qos})
            for topic, kind in topics.items()
        }
        self._writer.add_metadata('pkm', metadata)
        self.counts = Counter()
        self._start, self._end = None, 0

    def write(self, topic, data, time):
        """Add the serialized message `data` at simulated `time` [ns]."""
        if self._start is None:
            self._start = time
        self._end = max(self._end, time)
        self._writer.add_message(self._channels[topic], time, data, time, self.counts[topic])
        self.counts[topic] += 1

    def close(self, facts):
        """
        Finish the file, write metadata.yaml and read the file's summary back.

        Parameters
        ----------
        facts : dict of str to str
            What is known only now; joins the metadata.

        Raises
        ------
        BagError
            If the file does not hold every message that was written.

        """
        self._writer.add_metadata('pkm_end', facts)
        start, total = self._start or 0, self.counts.total()
        duration = {'nanoseconds': self._end - start}
        info = {
            'version': 9,
            'storage_identifier': 'mcap',
            'relative_file_paths': [self._file.name],
            'duration': duration,
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': total,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic,
                        'type': kind,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': [_QOS],
                        'type_description_hash': typestore().hash_rihs01(kind),
                    },
                    'message_count': self.counts[topic],
                }
                for topic, kind in self._topics.items()
            ],
            'compression_format': '',
            'compression_mode': '',
            'files': [
                {
                    'path': self._file.name,
                    'starting_time': {'nanoseconds_since_epoch': start},
                    'duration': dict(duration),
                    'message_count': total,
                }
            ],
            'custom_data': self._metadata | facts,
            'ros_distro': 'jazzy',
        }
        self._writer.add_metadata('rosbag2', {'serialized_metadata': _dump(info)})
        self._writer.finish()
        self._stream.close()
        (self.path / 'metadata.yaml').write_text(_dump({'rosbag2_bagfile_information': info}), encoding='utf-8')
        with self._file.open('rb') as stream:
            statistics = make_reader(stream).get_summary().statistics
        written = {
            topic: statistics.channel_message_counts.get(channel, 0) for topic, channel in self._channels.items()
        }
        if any(written[topic] != self.counts[topic] for topic in self._topics):
            raise BagError(f'{self._file}: holds {written} messages; {dict(self.counts)} were written')


class _NoAliases(yaml.SafeDumper):
    def ignore_aliases(self, data):
        return True


def _dump(data):
    return yaml.dump(data, Dumper=_NoAliases, sort_keys=False)


def read_metadata(path):
    """Return what metadata.yaml says of the bag folder `path`."""
    file = Path(path) / 'metadata.yaml'
    try:
        return yaml.safe_load(file.read_text(encoding='utf-8'))['rosbag2_bagfile_information']
    except (OSError, yaml.YAMLError, KeyError, TypeError) as error:
        raise BagError(f'{file}: cannot be read as the metadata of a bag: {error}') from None


def read_topics(path, topics):
    """
    Return the messages of `topics` in the bag folder `path`, oldest first.

    Returns
    -------
    messages : dict of str to list
        Deserialized messages by topic; an empty list where the bag has none.

    Raises
    ------
    BagError
        If `path` is no bag or cannot be read.

    """
    messages = {topic: [] for topic in topics}
    try:
        with AnyReader([Path(path)], default_typestore=typestore()) as reader:
            connections = [connection for connection in reader.connections if connection.topic in messages]
            for connection, _, data in reader.messages(connections=connections):
                messages[connection.topic].append(reader.deserialize(data, connection.msgtype))
    except (AnyReaderError, OSError, ValueError, AssertionError) as error:
        raise BagError(f'{path}: cannot be read as a bag: {error}') from None
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
