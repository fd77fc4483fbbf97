"""Odd files in the place of bags: refused in one line with file, topic and reason, within bounds of memory."""

import io
import os
import shutil

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import raw_messages, read_topics
from pkm_core.bag.repair import repair
from pkm_core.errors import BagError
from pkm_core.mcap_records import LARGEST_CHUNK, DamageError, McapFile
from pkm_core.reporting.runs import read_run

NUMBER = b'\x00\x01\x00\x00' + bytes(12)


def mcap_of(bag):
    return next(bag.glob('*.mcap'))


def foreign(path, *, text=b'float64 data\n', schema=True, compression=CompressionType.ZSTD):
    """Write an MCAP file of 2000 messages on /axis with the definition `text`."""
    with path.open('wb') as stream:
        writer = Writer(stream, compression=compression)
        writer.start(profile='ros2')
        kind = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', text) if schema else 0
        channel = writer.register_channel('/axis', 'cdr', kind)
        for number in range(2000):
            data = NUMBER[:4] + np.random.default_rng(number).bytes(8)
            writer.add_message(channel, number, data, number)
        writer.finish()
    return path


def chunk(data, size, compression='zstd'):
    return Chunk(
        compression=compression,
        data=data,
        message_end_time=0,
        message_start_time=0,
        uncompressed_crc=0,
        uncompressed_size=size,
    )


def unpacked(*chunks):
    """Return the refusal of the last of `chunks` in a file of 1 kB."""
    file = McapFile(io.BytesIO(bytes(1000)))
    for each in chunks[:-1]:
        file.unpack(each)
    with pytest.raises(DamageError) as refusal:
        file.unpack(chunks[-1])
    return str(refusal.value)


def zstd(size, **options):
    """Return `size` zeros as a zstd frame."""
    return zstandard.ZstdCompressor(**options).compress(bytes(size))


@pytest.mark.parametrize('size', [LARGEST_CHUNK + 1, 2**63, 2**64 - 1])
def test_chunk_that_states_a_huge_size_is_refused_at_once(size):
    assert 'unpacks to more than 64 MB' in unpacked(chunk(zstd(100), size))


@pytest.mark.parametrize(
    ('data', 'compression'),
    [
        (zstd(10**8), 'zstd'),
        (zstd(10**8, write_content_size=False), 'zstd'),
        (lz4.frame.compress(bytes(10**8)), 'lz4'),
        (bytes(5000), ''),
        (b'', 'zstd'),
        (b'', 'lz4'),
        (bytes(10), 'brotli'),
    ],
)
def test_chunk_of_another_size_than_stated_is_refused(data, compression):
    with pytest.raises(Exception, match=r'a chunk|content size'):
        McapFile(io.BytesIO(bytes(1000))).unpack(chunk(data, 4000, compression))


def test_many_chunks_of_zeros_are_refused_in_sum():
    """Each is below the limit of a chunk."""
    bomb = chunk(bytes(30_000_000), 30_000_000, '')
    bomb.data = b'\x80' + (30_000_000 - 9).to_bytes(8, 'little') + bytes(30_000_000 - 9)  # one unknown record
    assert 'unpacks to more than 64 MB; the file has 0.001 MB' in unpacked(bomb, bomb, bomb)


def test_record_beyond_its_chunk_is_refused():
    builder = RecordBuilder()
    builder.start_record(5)
    builder.write(bytes(30))
    builder.finish_record()
    record = bytearray(builder.end())
    record[1:9] = (2**62).to_bytes(8, 'little')
    assert 'a record of a chunk has kind 5 and 4611686018427387904 bytes' in unpacked(chunk(bytes(record), 39, ''))


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        ({'schema': False}, '/axis: its messages have no schema'),
        ({'text': b'this is no definition <<>>\n'}, 'std_msgs/msg/Float64: its definition in the bag cannot be used'),
        ({'text': b'string data\n'}, '/axis: message 0 is not a std_msgs/msg/Float64'),
        ({'text': b'\xff\xfe\n'}, 'std_msgs/msg/Float64: its definition in the bag cannot be used'),
    ],
)
def test_odd_schema_is_refused_with_file_and_topic(tmp_path, options, reason):
    path = foreign(tmp_path / 'odd.mcap', **options)
    with pytest.raises(BagError, match=reason) as refusal:
        read_topics(path)
    assert str(refusal.value).startswith(str(path))
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize('compression', [CompressionType.LZ4, CompressionType.ZSTD])
def test_damaged_chunk_is_refused_with_its_topics(tmp_path, compression):
    path = foreign(tmp_path / 'odd.mcap', compression=compression)
    content = bytearray(path.read_bytes())
    content[200:240] = bytes(40)
    path.write_bytes(content)
    with pytest.raises(BagError, match=r'odd\.mcap: .*/axis'):
        read_topics(path)


def damaged_by(path, kind):
    """Put something else in the place of the file `path`."""
    path.unlink()
    if kind == 'pipe':
        os.mkfifo(path)
    elif kind == 'folder':
        path.mkdir()
    elif kind == 'loop':
        path.symlink_to(path)


@pytest.mark.parametrize('kind', ['pipe', 'folder', 'loop'])
@pytest.mark.parametrize('name', ['*.mcap', 'metadata.yaml'])
def test_something_else_in_place_of_a_file_is_refused(write_bag, kind, name):
    bag = write_bag()
    damaged_by(next(bag.glob(name)), kind)
    with pytest.raises(BagError) as refusal:
        read_cycle(bag)
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize(
    'text',
    [
        '',
        'null',
        '5',
        'rosbag2_bagfile_information:',
        'rosbag2_bagfile_information: [1]',
        'a: 2020-99-01',
        'a: [',
        '\0',
    ],
)
def test_odd_metadata_is_refused_by_reader_and_repaired(write_bag, text):
    bag = write_bag()
    (bag / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match='cannot be read as the metadata of a bag') as refusal:
        read_cycle(bag)
    assert '\n' not in str(refusal.value)
    assert read_cycle(repair(bag).path).is_whole


def test_huge_metadata_is_refused_without_being_read(write_bag):
    bag = write_bag()
    with (bag / 'metadata.yaml').open('wb') as stream:
        stream.truncate(10**10)
    with pytest.raises(BagError, match='has 10000000 kB; allowed 2000 kB'):
        read_cycle(bag)


def test_hidden_file_of_macos_does_not_count(write_bag):
    bag = write_bag()
    (bag / f'._{mcap_of(bag).name}').write_bytes(b'Mac OS X')
    assert read_cycle(bag).is_whole
    assert repair(bag) is None


@pytest.mark.parametrize('whole', [True, False])
def test_file_in_a_bag_stands_for_the_bag(write_bag, whole):
    """A repair is written beside the bag, never into it."""
    bag = write_bag()
    if not whole:
        (bag / 'metadata.yaml').unlink()
    before = sorted(bag.iterdir())
    result = repair(mcap_of(bag))
    assert (result is None) == whole
    assert whole or result.path == bag.with_name(f'{bag.name}_repaired')
    assert sorted(bag.iterdir()) == before


def test_one_damaged_bag_does_not_take_the_others_along(write_bag, tmp_path):
    """The folder of a run: a whole cycle, a cut one, one whose metadata is odd, a pipe and a folder."""
    for number in range(1, 6):
        write_bag(number=number, metadata={'machine': 'four_dof'})
    bags = sorted(tmp_path.iterdir())
    mcap_of(bags[1]).write_bytes(mcap_of(bags[1]).read_bytes()[:-4000])
    (bags[2] / 'metadata.yaml').write_text('null')
    damaged_by(mcap_of(bags[3]), 'pipe')
    damaged_by(mcap_of(bags[4]), 'folder')
    run = read_run(tmp_path)
    assert [record.cycle for record in run.records] == [1]
    assert len(run.remarks) == 4
    for bag, remark in zip(bags[1:], run.remarks, strict=True):
        assert str(bag) in remark
        assert '\n' not in remark


def test_bag_of_another_machine_is_named_in_a_report(write_bag, make_cycle, tmp_path):
    write_bag(make_cycle('planar'), metadata={'machine': 'four_dof'})
    with pytest.raises(BagError, match=r"joints \['d1', 'd3'\]; four_dof has"):
        read_run(tmp_path)


def test_copy_of_a_whole_file_alone_is_read(write_bag, tmp_path):
    """Without the folder there is no metadata; the messages are whole."""
    path = tmp_path / 'alone.mcap'
    shutil.copy(mcap_of(write_bag()), path)
    assert sum(1 for _ in raw_messages(path, ['/pkm/d1/encoder'])) == 400
