"""Integrity of a bag: every byte of its MCAP files is under a checksum, and metadata.yaml repeats their metadata."""

from collections import Counter

from mcap.records import Chunk, ChunkIndex, DataEnd, Footer, Message, MessageIndex, Metadata

from pkm_core.bag.reader import bag_files, opened, read_metadata
from pkm_core.errors import BagError
from pkm_core.mcap_records import DamageError, RawMessage
from pkm_core.yaml_text import parse_written

_SUMS = ('message_count', 'relative_file_paths')  # keys of metadata.yaml that a split bag has in sum


def is_whole(path):
    """
    Return whether the bag folder `path` is as its recorder closed it.

    Every MCAP file must pass `file_metadata`, and metadata.yaml must equal the metadata in the files.
    """
    try:
        info = read_metadata(path)
        parts = [file_metadata(file) for file in bag_files(path)]
    except BagError:
        return False
    if len(parts) == 1:
        return info == parts[0]
    names = [name for part in parts for name in part['relative_file_paths']]
    sums = sum(part['message_count'] for part in parts), names
    return tuple(info[key] for key in _SUMS) == sums


def file_metadata(file):
    """
    Return the metadata of rosbag2 stored in the MCAP file `file` after a check of the whole file.

    Checked are the checksums of chunks, data section and summary, the index of chunks and of messages, which other
    readers follow, and the counts of messages.

    Raises
    ------
    BagError
        If the file has any damage.

    """
    with opened(file) as mcap:
        summary, found = mcap.summary(), _Found()
        for record in mcap.records(check=True):
            found.take(mcap, record)
        if mcap.tell() != mcap.size:
            raise DamageError(f'has {mcap.size - mcap.tell()} bytes after its end')
        found.compare(summary)
        return parse_written(found.metadata['serialized_metadata'])


class _Found:
    """What the records of a file hold, in the order of the file."""

    def __init__(self):
        self.counts, self.metadata = Counter(), {}
        self._chunks, self._index = 0, {}  # index of the last chunk: its messages by channel

    def take(self, mcap, record):
        """Count a record of `mcap`; `DamageError` if it contradicts those before it."""
        if isinstance(record, Chunk):
            self._require_index()
            self._chunks += 1
            self._index = {}
            for inner in mcap.unpack(record):
                if isinstance(inner, RawMessage):
                    self._index.setdefault(inner.channel, []).append(inner.time)
            self.counts += {channel: len(times) for channel, times in self._index.items()}
        elif isinstance(record, MessageIndex):
            if [time for time, _ in record.records] != self._index.pop(record.channel_id, None):
                raise DamageError('an index of messages contradicts its chunk')
        elif isinstance(record, Message):
            self.counts[record.channel_id] += 1
        elif isinstance(record, Metadata) and record.name == 'rosbag2':
            self.metadata = record.metadata
        elif isinstance(record, (DataEnd, Footer, ChunkIndex)):
            self._require_index()

    def _require_index(self):
        if self._index:
            raise DamageError('a chunk lacks its index of messages')

    def compare(self, summary):
        """Raise `DamageError` if the `Summary` of the file contradicts its records."""
        if summary is None or summary.statistics is None:
            raise DamageError('has no summary')
        stated = {channel: n for channel, n in summary.statistics.channel_message_counts.items() if n}
        if stated != +self.counts or len(summary.chunk_indexes) != self._chunks:
            raise DamageError(f'holds {self.counts.total()} messages; its summary states {sum(stated.values())}')
