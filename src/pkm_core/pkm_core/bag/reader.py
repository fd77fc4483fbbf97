"""
Reads bags without ROS: rosbag2 folders of MCAP files and a metadata.yaml, as written by writer.py.

The time of a message is the simulated time of its tick.
"""

import struct
from contextlib import contextmanager
from heapq import merge
from operator import itemgetter
from pathlib import Path

import numpy as np
import yaml
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from zstandard import ZstdError

from pkm_core.bag.message_types import types_of
from pkm_core.errors import BagError

# errors raised for a damaged file; a wrong checksum of a chunk is a ValueError
DAMAGE = (McapError, SerdeError, TypesysError, ZstdError, struct.error, ValueError, KeyError)


@contextmanager
def damage_refused(file, advice=''):
    """Convert the errors of the readers for an unreadable or damaged `file` into a `BagError`."""
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror}') from None
    except (AttributeError, *DAMAGE) as error:  # AttributeError: the summary or a schema is missing
        raise BagError(f'{file}: cannot be read as a bag: {_reason(error)}{advice}') from None


@contextmanager
def _reader(file, bag):
    """Open `file` of the bag `bag` and yield its reader."""
    with damage_refused(file, f'; try: pkm bag-doctor {bag}'), file.open('rb') as stream:
        yield SeekingReader(stream, validate_crcs=True, record_size_limit=file.stat().st_size)


def _reason(error):
    """Return the text of `error` in one line."""
    return ' '.join(str(error).split()) or type(error).__name__


def read_metadata(path):
    """Return the content of metadata.yaml of the bag folder `path`."""
    file = Path(path) / 'metadata.yaml'
    if not file.exists() and any(Path(path).glob('*.mcap')):
        raise BagError(f'{path}: has no metadata.yaml (the recorder was killed); try: pkm bag-doctor {path}')
    try:
        return yaml.load(file.read_text(encoding='utf-8'), yaml.CSafeLoader)['rosbag2_bagfile_information']
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        raise BagError(f'{file}: cannot be read as the metadata of a bag: {_reason(error)}') from None


def bag_files(path):
    """Return the MCAP files of the bag folder `path`, oldest first, or `path` if it is a file; else `BagError`."""
    path = Path(path)
    if path.is_file():
        return [path]
    if not path.exists():
        raise BagError(f'{path}: no such file or folder')
    files = list(path.glob('*.mcap'))
    if len(files) == 1:
        return files
    # a split bag: NAME_0.mcap, NAME_1.mcap, ...
    stems = {file.stem.rpartition('_')[0] for file in files}
    named = [path / f'{stem}_{number}.mcap' for stem in stems for number in range(len(files))]
    if len(stems) != 1 or set(named) != set(files):
        raise BagError(
            f'{path}: not a bag of this cell: has {len(files)} MCAP files; expected 1, or NAME_0.mcap, NAME_1.mcap, ...'
        )
    return named


def raw_messages(path, topics=None):
    """
    Yield (topic, message type, serialized bytes, time [ns]) of the bag `path`, oldest first, for `topics` or all.

    Messages of the same time are in the order of recording.

    Raises
    ------
    BagError
        If `path` is not a bag or cannot be read.

    """
    per_file = [_file_messages(file, path, topics) for file in bag_files(path)]
    yield from merge(*per_file, key=itemgetter(3)) if len(per_file) > 1 else per_file[0]


def _file_messages(file, bag, topics):
    with _reader(file, bag) as reader:
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
        Topics to read; by default all with messages.

    Returns
    -------
    messages : dict of str to list
        Deserialized messages by topic; an empty list for a requested topic without messages.

    Raises
    ------
    BagError
        If `path` is not a bag or cannot be read.

    """
    messages, schemas = {topic: [] for topic in topics or ()}, {}
    for file in bag_files(path):
        with _reader(file, path) as reader:
            schemas |= {schema.name: schema for schema in reader.get_summary().schemas.values()}
    with damage_refused(path):
        types = types_of(schemas.values())
        for topic, kind, data, _ in raw_messages(path, topics):
            messages.setdefault(topic, []).append(types.deserialize_cdr(data, kind))
    return messages


def column(messages, field):
    """Return one field of `messages` as an array, one row per message."""
    return np.array([getattr(message, field) for message in messages])
