"""
Reads bags without ROS: rosbag2 folders of MCAP files and a metadata.yaml, as written by writer.py.

The time of a message is the simulated time of its tick.
"""

from contextlib import contextmanager
from heapq import merge
from operator import itemgetter
from pathlib import Path

import numpy as np

from pkm_core.bag.message_types import types_of
from pkm_core.errors import BagError
from pkm_core.mcap_records import McapFile
from pkm_core.yaml_text import LONGEST_WRITTEN, YamlError, parse_written, read_text


@contextmanager
def damage_refused(file, advice=''):
    """
    Convert any error about an unreadable or damaged `file` into a `BagError` of one line.

    The packages mcap, rosbags, zstandard and lz4 raise two dozen kinds of errors for a damaged file.
    """
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror or error}') from None
    except Exception as error:
        raise BagError(f'{file}: cannot be read as a bag: {reason_of(error)}{advice}') from None


@contextmanager
def opened(file, advice=''):
    """Open the MCAP file `file` and yield its `McapFile`; errors as `damage_refused`."""
    with damage_refused(file, advice):
        if not file.is_file():
            raise BagError(f'{file}: is no regular file' if file.exists() else f'{file}: no such file')
        with file.open('rb') as stream:
            yield McapFile(stream)


def _doctor(bag):
    return f'; try: pkm bag-doctor {bag}'


def reason_of(error):
    """Return the text of `error` in one line of at most 200 characters."""
    text = ' '.join(str(error).split())[:200]
    if isinstance(error, KeyError):
        return f'{text} is missing or unknown'
    return text or type(error).__name__


def read_metadata(path):
    """
    Return the content of metadata.yaml of the bag folder `path`.

    Raises
    ------
    BagError
        If there is none, or it is not what a recorder writes.

    """
    path = Path(path)
    file = path / 'metadata.yaml'
    if not file.exists() and any(path.glob('*.mcap')):
        raise BagError(f'{path}: has no metadata.yaml (the recorder was killed){_doctor(path)}')
    try:
        content = parse_written(read_text(file, LONGEST_WRITTEN))
    except (OSError, UnicodeDecodeError, YamlError) as error:
        reason = getattr(error, 'strerror', None) or reason_of(error)
        raise BagError(f'{file}: cannot be read as the metadata of a bag: {reason}') from None
    wrong = _wrong_in(content)
    if wrong:
        raise BagError(f'{file}: cannot be read as the metadata of a bag: {wrong}{_doctor(path)}')
    return content['rosbag2_bagfile_information']


def _wrong_in(content):
    """Return what `content` lacks as the metadata of a bag, or ''."""
    info = content.get('rosbag2_bagfile_information') if isinstance(content, dict) else None
    if not isinstance(info, dict):
        return "has no mapping 'rosbag2_bagfile_information'"
    topics, facts, files = (
        info.get(key) for key in ('topics_with_message_count', 'custom_data', 'relative_file_paths')
    )
    if not _is_count(info.get('message_count')):
        return f'message_count is {info.get("message_count")!r:.80}; expected an integer, 0 or more'
    if not isinstance(topics, list) or not all(map(_is_topic, topics)):
        return 'topics_with_message_count is no list of topics, each with name, type and message_count'
    if not isinstance(files, list) or not all(isinstance(name, str) for name in files):
        return 'relative_file_paths is no list of names'
    if facts is not None and not (isinstance(facts, dict) and all(map(_is_fact, facts.items()))):
        return 'custom_data is no mapping of texts'
    return ''


def _is_count(value):
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _is_topic(entry):
    about = entry.get('topic_metadata') if isinstance(entry, dict) else None
    named = isinstance(about, dict) and all(isinstance(about.get(key), str) for key in ('name', 'type'))
    return named and _is_count(entry.get('message_count'))


def _is_fact(item):
    return all(isinstance(text, str) for text in item)


def bag_files(path):
    """
    Return the MCAP files of the bag folder `path`, oldest first, or `path` if it is a file; else `BagError`.

    Hidden files, such as ``._x.mcap`` of macOS, do not count.
    """
    path = Path(path)
    if path.is_file():
        return [path]
    if not path.exists():
        raise BagError(f'{path}: no such file or folder')
    if not path.is_dir():
        raise BagError(f'{path}: is no regular file and no folder')
    with damage_refused(path):
        files = [file for file in path.glob('*.mcap') if not file.name.startswith('.')]
    odd = [file for file in files if not file.is_file()]
    if odd:
        raise BagError(f'{odd[0]}: is no regular file; expected an MCAP file')
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
    with opened(file, _doctor(bag)) as mcap:
        yield from mcap.messages(topics)


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
        with opened(file, _doctor(path)) as mcap:
            summary = mcap.summary()
            if summary is None:
                raise BagError(f'{file}: has no summary{_doctor(path)}')
            schemas |= {schema.name: schema for schema in summary.schemas.values()}
    types = _types_of(path, schemas)
    for topic, kind, data, _ in raw_messages(path, topics):
        taken = messages.setdefault(topic, [])
        try:
            taken.append(types.deserialize_cdr(data, kind))
        except Exception as error:  # rosbags raises whatever the odd bytes lead to
            raise BagError(f'{path}: {topic}: message {len(taken)} is not a {kind}: {reason_of(error)}') from None
    return messages


def _types_of(path, schemas):
    try:
        return types_of(schemas.values())
    except BagError as error:
        raise BagError(f'{path}: {error}') from None


def column(messages, field):
    """Return one field of `messages` as an array, one row per message."""
    return np.array([getattr(message, field) for message in messages])
