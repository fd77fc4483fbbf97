"""Messages written in blocks give the same file as mcap's own writer message by message."""

import io
import sys

import numpy as np
from mcap.writer import CompressionType, Writer

from pkm_core.bag.mcap_blocks import BlockWriter


def written(writer_class, write):
    """Return the file of a writer of `writer_class`, filled by `write(writer, channels)`."""
    stream = io.BytesIO()
    writer = writer_class(stream, chunk_size=sys.maxsize, compression=CompressionType.ZSTD)
    writer.start(profile='ros2', library='test')
    schema = writer.register_schema('std_msgs/msg/UInt64', 'ros2msg', b'uint64 data')
    write(writer, [writer.register_channel(topic, 'cdr', schema) for topic in ('/a', '/b')])
    writer.finish()
    return stream.getvalue()


def test_file_equals_that_of_mcap_byte_for_byte():
    """Three chunks; one has a channel twice, times overlap and decrease, and sizes change."""
    random = np.random.default_rng(1)
    blocks = [(0, 5, 44, 10), (1, 7, 44, 8), (0, 1, 1000, 15), None, (1, 300, 12, 2**40), None, (0, 2, 4, 0)]
    blocks = [
        block and (block[0], block[3] + np.arange(block[1]), random.integers(0, 256, block[1:3], dtype=np.uint8))
        for block in blocks
    ]

    def in_blocks(writer, channels):
        sequences = [0, 0]
        for block in blocks:
            if block is None:
                writer.flush()
                continue
            channel, times, messages = block
            writer.add_messages(channels[channel], times, messages, sequences[channel])
            sequences[channel] += len(messages)

    def one_by_one(writer, channels):
        sequences = [0, 0]
        for block in blocks:
            if block is None:
                writer.flush()
                continue
            channel, times, messages = block
            for time, message in zip(times.tolist(), messages, strict=True):
                writer.add_message(channels[channel], time, message.tobytes(), time, sequences[channel])
                sequences[channel] += 1

    assert written(BlockWriter, in_blocks) == written(Writer, one_by_one)
