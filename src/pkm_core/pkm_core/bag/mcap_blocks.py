"""
An MCAP writer that takes many messages of a channel at once.

The writer of the `mcap` package builds every message and every index entry field by field in Python: 4 us per message,
at eight messages per servo tick. Here messages of equal size are one numpy array, and the fields around them are filled
column by column. The bytes written are the same; all other records are written by `mcap`. Two private attributes of its
writer are used, because it has no public access for this: the version is pinned.
"""

from functools import lru_cache

import numpy as np
from mcap._chunk_builder import ChunkBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import Writer

# [bytes] opcode and length of a record, which are not included in its length
RECORD_HEAD = 9


@lru_cache(maxsize=256)
def _message_records(size):
    """Return the layout of an MCAP message record around `size` bytes of data, https://mcap.dev/spec#message-op0x05."""
    times = [('log_time', '<u8'), ('publish_time', '<u8')]
    head = [('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4')]
    return np.dtype([*head, *times, ('data', 'u1', (size,))])


class BlockWriter(Writer):
    """A `mcap.writer.Writer` with `add_messages`; chunked, no `add_message`."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        self._Writer__chunk_builder = self._chunk = _Chunk()

    def add_messages(self, channel, times, messages, sequence):
        """
        Add messages of one channel and of equal size to the chunk.

        Parameters
        ----------
        channel : int
            Channel number of `register_channel`.
        times : ndarray, shape (n,)
            Time of logging and of publication [ns].
        messages : ndarray of uint8, shape (n, size)
            Serialized messages.
        sequence : int
            Sequence number of the first; those of the others follow.

        """
        first, last = int(times.min()), int(times.max())
        statistics = self._statistics()
        if statistics.message_count == 0:
            statistics.message_start_time = first
        statistics.message_start_time = min(first, statistics.message_start_time)
        statistics.message_end_time = max(last, statistics.message_end_time)
        statistics.channel_message_counts[channel] += len(messages)
        statistics.message_count += len(messages)
        self._chunk.add_messages(channel, times, messages, sequence, first, last)

    def span(self):
        """Return the times [ns] of the oldest and the newest message so far; at least one must have been added."""
        statistics = self._statistics()
        return statistics.message_start_time, statistics.message_end_time

    def _statistics(self):
        return vars(self)['_Writer__statistics']


class _Chunk(ChunkBuilder):
    """A chunk to which messages are added in blocks."""

    def add_messages(self, channel, times, messages, sequence, first, last):
        """Append the records of `messages`, which span the times `first` to `last` [ns], and their index."""
        number, size = messages.shape
        layout = _message_records(size)
        records = np.empty(number, layout)
        records['opcode'] = Opcode.MESSAGE
        records['length'] = layout.itemsize - RECORD_HEAD
        records['channel'] = channel
        records['sequence'] = np.arange(sequence, sequence + number)
        records['log_time'] = records['publish_time'] = times
        records['data'] = messages

        entries = np.empty((number, 2), '<u8')
        entries[:, 0] = times
        entries[:, 1] = np.arange(self.count, self.count + records.nbytes, layout.itemsize)
        if channel not in self.message_indices:
            self.message_indices[channel] = _Index(channel, [])
        self.message_indices[channel].records.append(entries)  # type: ignore[arg-type]  # _Index has arrays

        self.message_start_time = first if self.num_messages == 0 else min(first, self.message_start_time)
        self.message_end_time = max(last, self.message_end_time)
        self.num_messages += number
        self.record_writer.write(records.tobytes())


class _Index(MessageIndex):
    """The index of a channel in a chunk; its `records` are arrays (n, 2) of times [ns] and offsets [bytes]."""

    def write(self, stream):
        """Append the record to `stream`."""
        entries = np.concatenate(self.records).tobytes()
        stream.start_record(Opcode.MESSAGE_INDEX)
        stream.write2(self.channel_id)
        stream.write4(len(entries))
        stream.write(entries)
        stream.finish_record()
